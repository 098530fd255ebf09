"""95 % intervals of means over few clusters, such as seeds; they contain only possible values of the quantity.

Shares are Clopper and Pearson's with an effective number of samples (Korn & Graubard 1998), rates of events Garwood's
with an effective number of events, everything else Student's within its bounds. What was never seen is not certain.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.common.bootstrap import FloatArray, IntArray, Interval
from harness.common.effects import LEVEL

SHARED = 0.05
"""Intraclass correlation of outcomes of one seed where none differs, so that it can't be told. Over 155 shares of
occlusions, each of five seeds or more, its median is 0.00, and nine in ten are below 0.06 (tables of 108b5b1)."""
OVERDISPERSED = 2.0
"""Variance over mean of events a seed where none was seen; hard brakes of 200 drives had 1.2 to 1.9."""
NONE = Interval(np.nan, np.nan)


@dataclass(frozen=True)
class Possible:
    """The least and the largest value that a mean can have.

    ``events`` says how many events one of its sums stands for, where it is a rate of events; 0 where it is none.
    ``is_share`` says that a mean from 0 to a finite ``most`` is a share of it: its interval is that of a proportion.
    Others have Student's interval, cut off at the two ends.
    """

    least: float = 0.0
    most: float = np.inf
    events: float = 0.0
    is_share: bool = True


NONNEGATIVE, ANY = Possible(), Possible(-np.inf)


def possible_ci(sums: FloatArray, counts: FloatArray, possible: Possible) -> Interval:
    """Return the 95 % interval of the ratio of two totals over independent clusters, of shape (clusters,).

    ``counts`` are numbers of values, or weights; clusters of none count nothing. Bounds are nan with fewer than two
    clusters, or where nothing is known of the scatter.
    """
    known = counts > 0.0
    sums, counts = sums[known], counts[known]
    clusters, total = len(sums), float(counts.sum())
    if clusters < 2:
        return NONE
    mean = float(sums.sum()) / total
    variance = clusters / (clusters - 1.0) * float((((sums - mean * counts) / total) ** 2).sum())
    # A variance of few clusters is itself uncertain: Student's quantile over the normal one, as Korn and Graubard do.
    few = (special.ndtri(1.0 - 0.5 * LEVEL) / special.stdtrit(clusters - 1, 1.0 - 0.5 * LEVEL)) ** 2
    if possible.is_share and possible.least == 0.0 and np.isfinite(possible.most):
        share = min(max(mean / possible.most, 0.0), 1.0)
        scatter = variance / possible.most**2
        if scatter > 0.0:
            successes = sums / possible.most
            binary = np.allclose(successes, np.round(successes), atol=1e-6)
            effective = share * (1.0 - share) / scatter
            effective = few * (min(effective, total) if binary else effective)
        else:
            effective = total / (1.0 + SHARED * (total / clusters - 1.0))
        low, high = clopper_pearson(share, effective)
        return Interval(possible.most * low, possible.most * high)
    if possible.events and mean <= 0.0:
        return Interval(0.0, -np.log(0.5 * LEVEL) * OVERDISPERSED / (possible.events * total))
    if variance == 0.0:
        return NONE
    if possible.events:
        events = min(mean**2 / variance, mean * possible.events * total)
        low, high = garwood(few * events)
        return Interval(mean * low, mean * high)
    # A percentile bootstrap over few clusters is too narrow: it covers 74 % of 95 % with three of them.
    half = float(special.stdtrit(clusters - 1, 1.0 - 0.5 * LEVEL) * np.sqrt(variance))
    return Interval(max(mean - half, possible.least), min(mean + half, possible.most))


def clustered_ci(values: FloatArray, cluster: IntArray) -> Interval:
    """Return the 95 % interval of the mean of values that are not negative, over their clusters, both of shape (n,).

    Bounds are nan with fewer than two clusters.
    """
    names, place = np.unique(cluster, return_inverse=True)
    sums, counts = (np.bincount(place, each, len(names)).astype(np.float64) for each in (values, np.ones(len(values))))
    return possible_ci(sums, counts, NONNEGATIVE)


def clopper_pearson(share: float, samples: float) -> tuple[float, float]:
    """Return the 95 % interval of a share of independent samples, whose number need not be whole (Clopper 1934)."""
    hits, misses = share * samples, (1.0 - share) * samples
    low = special.betaincinv(hits, misses + 1.0, 0.5 * LEVEL) if hits > 0.0 else 0.0
    high = special.betaincinv(hits + 1.0, misses, 1.0 - 0.5 * LEVEL) if misses > 0.0 else 1.0
    return float(low), float(high)


def garwood(events: float) -> tuple[float, float]:
    """Return the 95 % interval of a rate as shares of its estimate from so many events (Garwood 1936), above none."""
    low, high = special.gammaincinv([events, events + 1.0], [0.5 * LEVEL, 1.0 - 0.5 * LEVEL]) / events
    return float(low), float(high)
