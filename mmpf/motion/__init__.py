"""Motion models: how a vehicle may move in one time step, given the road and traffic around it."""

from mmpf.motion.protocol import MotionModel, motion_models

__all__ = ["motion_model"]


def motion_model(name: str) -> MotionModel:
    """Return the motion model of that name with its default parameters.

    Raises:
        UnknownNameError: There is none.
    """
    return motion_models[name]()
