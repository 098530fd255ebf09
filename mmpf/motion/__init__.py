"""Motion models: how a vehicle may move in one time step, given road and traffic around it.

Importing the package fills ``mmpf.motion.protocol.motion_models``.
"""

from mmpf.motion import idm, kinematic
from mmpf.motion.learned import driver, lane_changer, short_driver, short_pair
from mmpf.motion.protocol import MotionModel, motion_models

__all__ = ["driver", "idm", "kinematic", "lane_changer", "motion_model", "short_driver", "short_pair"]


def motion_model(name: str) -> MotionModel:
    """Return the motion model of that name with its default parameters.

    Raises:
        UnknownNameError: There is none.
    """
    return motion_models[name]()
