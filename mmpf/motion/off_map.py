"""Motion in a plane without lanes: any motion model drives straight on, and its lateral drift turns the heading.

The inner model moves a vehicle in a frame that begins where it is and points where it points. What the model makes of
its lateral speed turns the vehicle: a vehicle goes where it points. The latents have the rows that motion along lanes
has (``mmpf.motion.lane_following``), so that whoever reads lanes or directions from particles finds them here too.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.motion.heading_measurements import drawn_directions
from mmpf.motion.lane_following import GUIDANCE_SIZE, HEADING, TURNING_STD, LaneFollowing, turn_of
from mmpf.motion.protocol import AroundAnother, MotionModel, Surroundings, without_limits
from mmpf.motion.standing import DRIFT_STD, drawn_standing, drift_in_place, hold_still
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray, turned, wrapped
from mmpf.scan import BodyHeadings


@dataclass(frozen=True)
class OffMapMotion(AroundAnother):
    """A motion model in the plane; see ``mmpf.motion.protocol.MotionModel``.

    Positions of the state are x and y; speeds and accelerations are along and across the particle's direction.

    Attributes:
        inner: How a vehicle moves along its direction.
        turning_std: Noise on the lateral speed by which vehicles turn, m/s per root second.
        drift_std: How far what stands drifts with the ego's own place, metres per root second.
    """

    own_rows: ClassVar[int] = GUIDANCE_SIZE
    turning_std: float = 0.0
    drift_std: float = 0.0

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Draw the inner model's latents, and any direction."""
        latents = np.full((self.latent_size, state.shape[1]), float(NOWHERE))
        latents[:-GUIDANCE_SIZE] = self.inner.draw_latents(state, rng)
        latents[HEADING] = rng.uniform(-np.pi, np.pi, state.shape[1])
        return latents

    def towards(self, latents: FloatArray, headings: BodyHeadings, rng: np.random.Generator) -> FloatArray:
        """Draw directions around measured ones; see ``TakesHeadings.towards``."""
        after = latents.copy()
        after[HEADING] = drawn_directions(latents[HEADING], headings, rng)
        return after

    def propagate(
        self, state: FloatArray, latents: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Let the inner model move the particles from where they are, and turn them to where they then go.

        Noise on the lateral speed turns them too, and adds nothing to their speed: whoever stands goes on standing.
        """
        local = state.copy()
        local[LON] = local[LAT] = local[LAT_SPEED] = 0.0
        moved, carried = self.inner.propagate(local, latents[:-GUIDANCE_SIZE], surroundings, dt_s, rng)
        steered = np.sqrt(dt_s) * self.turning_std * rng.standard_normal(state.shape[1])
        heading = latents[HEADING] + turn_of(state[SPEED], state[LAT_SPEED] + steered, dt_s)
        x, y = turned(moved[LON], moved[LAT], -heading)
        turn = turn_of(moved[SPEED], moved[LAT_SPEED], dt_s)
        moved[LON], moved[LAT] = state[LON] + x, state[LAT] + y
        # What a model steers is a part of the path's speed.
        moved[SPEED] = moved[SPEED] / np.cos(turn)
        moved[LAT_SPEED] = 0.0
        stands = drawn_standing(state[SPEED], dt_s, rng)
        hold_still(moved, state, stands)
        drift_in_place(moved, stands, self.drift_std * np.sqrt(dt_s), rng)
        after = latents.copy()
        after[:-GUIDANCE_SIZE] = carried
        after[HEADING] = wrapped(np.where(stands, latents[HEADING], heading + turn))
        return moved, after


def in_plane(motion: MotionModel, graph: LaneGraph) -> LaneFollowing | OffMapMotion:
    """Return how a model's vehicles move in the plane: along its lanes, or freely where no lanes are known."""
    motion = motion if graph.states_limits else without_limits(motion)
    return LaneFollowing(motion, graph, DRIFT_STD) if graph.has_map else OffMapMotion(motion, TURNING_STD, DRIFT_STD)
