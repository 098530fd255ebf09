import numpy as np
import pytest

from mmpf.joint.association import associate
from mmpf.joint.rule import _relative_clutter
from mmpf.options.joint import JointAssociation
from mmpf.scan import Detections


def scored(score):
    ones = np.ones(len(score))
    return Detections(ones, ones, ones, ones, ones, ones, score=np.array(score))


@pytest.mark.parametrize("weight", [1.0, 0.5])
def test_a_score_weighs_vehicles_old_and_new_by_its_odds_against_clutter(weight):
    options, psi, missed = JointAssociation(score_weight=weight, birth_density=0.4), 3.0, 0.2
    found = scored([0.9])
    odds = 9.0**weight
    marginals = associate(psi / _relative_clutter(found, options)[None, :], np.array([missed]), 0.4)
    # Bayes by enumeration: the component's detection, clutter or a newcomer.
    hit, other = odds * psi, missed * (1.0 + 0.4 * odds)
    assert marginals.probability[0, 0] == pytest.approx(hit / (hit + other))


def test_without_weight_or_score_nothing_changes():
    options = JointAssociation(score_weight=1.0)
    assert _relative_clutter(scored([0.2, 0.9]), JointAssociation()).tolist() == [1.0, 1.0]
    assert _relative_clutter(scored([0.5]), options).tolist() == [1.0]
