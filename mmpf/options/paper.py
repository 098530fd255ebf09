"""Settings of the paper's update only."""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import model_validator

from mmpf.options.base import Positive, Probability, Settings

Reading = Literal["literal", "charitable"]


class PaperAssociation(Settings):
    """Which components take part in the measurement update, and count as seen."""

    gate_std: Positive = float("inf")
    """A component with no detection within this many standard deviations performs no measurement update. Infinite in
    the paper: the largest likelihood counts however small it is.
    """
    hit_gate_std: Positive = 4.5
    """A component that performs an update counts as detected if a detection is within this many standard deviations."""


class PaperExistence(Settings):
    """When a component starts, and what it weighs at least."""

    added_particles: Probability = 0.1
    """a of the paper, as a share of one component's particles: a detection that fewer particles chose starts a
    component.
    """
    floor_weight: Probability = 0.0
    """Keeps component weights from falling below this share of the mean; zero is the paper's equation (11), whose
    product over time starves components.
    """
    weights_anew: bool = False
    """Whether component weights are reset to equal values before every scan, so that equation (11) uses that scan
    alone."""


class PaperRemoval(Settings):
    """When a component is let go."""

    weight: Probability = 0.0
    """r of the paper: a component whose weight falls below this share of the mean component weight is removed."""
    longest_unseen_s: Positive = 10.0
    """A component without detections for longer is removed."""
    unconfirmed_unseen_s: Positive = 10.0
    """An unconfirmed component without detections for longer is removed."""


class PaperResampling(Settings):
    """When the particles of a component are drawn anew."""

    effective_share: Probability = 0.5
    """A component is resampled when its effective sample size falls below this share of its particles."""


class PaperMerging(Settings):
    """When two components overlap significantly and become one."""

    lon_m: Positive = 2.5
    """Components overlap if their means are nearer than this along the road and ``lat_m`` across it."""
    lat_m: Positive = 1.0
    """See ``lon_m``."""
    keep_seen: bool = False
    """Whether a merged component keeps the identity of the confirmed one, then of the visible one, then of the older
    one.
    """


class PaperReclustering(Settings):
    """Which components' particles are dealt out anew by k-medoids."""

    lon_m: Positive = 7.0
    """Components touch if their means are nearer than this along the road and ``lat_m`` across it."""
    lat_m: Positive = 2.5
    """See ``lon_m``."""
    alike: bool = False
    """Whether all particles count equally, regardless of their weights and their component's weight."""


CHARITABLE: dict[str, dict[str, Any]] = {
    "association": {"gate_std": 3.0},
    "existence": {"weights_anew": True},
    "removal": {"unconfirmed_unseen_s": 1.0},
    "merging": {"keep_seen": True},
    "reclustering": {"lon_m": 3.0, "lat_m": 1.2, "alike": True},
}


class MaxLikelihoodOptions(Settings):
    """The paper's own rule: each particle's likelihood is its largest over all detections."""

    reading: Reading = "literal"
    """Interpretation of the paper where its text is ambiguous: literal, or the one most favourable to its rule.
    ``charitable`` changes the defaults of ``association.gate_std`` (3), ``existence.weights_anew`` (true),
    ``removal.unconfirmed_unseen_s`` (1), ``merging.keep_seen`` (true) and ``reclustering.lon_m``, ``lat_m`` and
    ``alike`` (3, 1.2, true); explicit settings are kept.
    """
    association: PaperAssociation = PaperAssociation()
    """Which components take part in the measurement update."""
    existence: PaperExistence = PaperExistence()
    """When a component starts."""
    removal: PaperRemoval = PaperRemoval()
    """When a component is let go."""
    resampling: PaperResampling = PaperResampling()
    """When particles are drawn anew."""
    merging: PaperMerging = PaperMerging()
    """When two components become one."""
    reclustering: PaperReclustering = PaperReclustering()
    """Which components' particles are dealt out anew."""

    @model_validator(mode="before")
    @classmethod
    def _read_charitably(cls, values: Any) -> Any:  # noqa: ANN401
        if not isinstance(values, Mapping) or values.get("reading") != "charitable":
            return values
        kindly = dict(values)
        for group, defaults in CHARITABLE.items():
            given = values.get(group, {})
            if isinstance(given, Mapping):
                kindly[group] = {**defaults, **given}
        return kindly
