"""Motion models: how a vehicle may move in one time step, given road and traffic around it.

Importing the package fills ``mmpf.motion.protocol.motion_models``.
"""

from mmpf.motion import adaptive_idm, bicycle, constant, idm, lane_changer, learned_driver, short_driver

__all__ = ["adaptive_idm", "bicycle", "constant", "idm", "lane_changer", "learned_driver", "short_driver"]
