"""Soft association: marginals of the bipartite components-by-detections graph by loopy belief propagation."""

from dataclasses import dataclass

import numpy as np

from mmpf.numerics.arrays import FloatArray
from mmpf.numerics.kernels import kernel

ROUNDS = 15
"""Of message passing."""


@dataclass(frozen=True)
class Marginals:
    """The result of belief propagation between m components and d detections.

    Attributes:
        detection_message: nu: how freely each detection offers itself to each component, shape (m, d).
        unexplained: Share of each detection that no component explains, shape (d,).
        probability: Probability that the detection came from the component, shape (m, d).
    """

    detection_message: FloatArray
    unexplained: FloatArray
    probability: FloatArray


def associate(evidence: FloatArray, missed: FloatArray, birth_density: float, exclusive: bool = True) -> Marginals:
    """Return association marginals (Williams and Lau 2014; Meyer et al., Proc. IEEE 2018, eqs. 30-32).

    Args:
        evidence: psi: weight of "the detection came from the component" against clutter, shape (m, d).
        missed: Weight of "the component gave no detection", shape (m,), positive.
        birth_density: b: weight of "the detection is a newborn vehicle" against clutter.
        exclusive: Whether a detection may come from one component only. If not, each component takes every
            detection as if it were alone, as in probabilistic data association.
    """
    components, detections = evidence.shape
    detection_message = np.full((components, detections), 1.0 / (1.0 + birth_density))
    if exclusive:
        component_message = np.zeros((components, detections))
        _pass_messages(evidence, missed, birth_density, component_message, detection_message)
    else:
        component_message = evidence / missed[:, None]
    nothing_else = 1.0 + birth_density
    unexplained = nothing_else / (nothing_else + component_message.sum(axis=0))
    weighted = evidence * detection_message
    probability = weighted / (missed + weighted.sum(axis=1))[:, None]
    return Marginals(detection_message, unexplained, probability)


def mean_entropy(probability: FloatArray) -> float:
    """Return the mean entropy of the components' association, nats; ``probability`` is that of ``Marginals``."""
    if probability.size == 0:
        return 0.0
    full = np.column_stack([probability, np.maximum(1.0 - probability.sum(axis=1), 0.0)])
    return float(-(full * np.log(np.maximum(full, 1e-300))).sum(axis=1).mean())


@kernel()
def _pass_messages(
    evidence: FloatArray,
    missed: FloatArray,
    birth_density: float,
    to_detection: FloatArray,
    to_component: FloatArray,
) -> None:
    """Update the messages, each of shape (m, d); initially no detection sends any and components send equal ones."""
    components, detections = evidence.shape
    for _ in range(ROUNDS):
        for t in range(components):
            total = missed[t]
            for j in range(detections):
                total += evidence[t, j] * to_component[t, j]
            for j in range(detections):
                others = total - evidence[t, j] * to_component[t, j]
                to_detection[t, j] = evidence[t, j] / max(others, 1e-300)
        for j in range(detections):
            total = 1.0 + birth_density
            for t in range(components):
                total += to_detection[t, j]
            for t in range(components):
                to_component[t, j] = 1.0 / max(total - to_detection[t, j], 1.0 + birth_density)
