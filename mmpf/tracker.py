"""The Modified Mixture Particle Filter of Li, Zhan and Tomizuka (2018): the loop of the paper's Fig. 1."""

from collections.abc import Callable

import numpy as np

from mmpf.belief.birth import Births, Traffic, give_birth, lies_on_ego
from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.rule import JointUpdate
from mmpf.map.road import Road
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.protocol import MotionModel
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import BoolArray
from mmpf.options.filter import FilterOptions, UpdateName
from mmpf.paper.rule import MaxLikelihoodUpdate
from mmpf.scan import Scan, SensorModel, check_scan
from mmpf.stages.prediction import Proposal, bootstrap_proposal, prior_update
from mmpf.stages.reporting import StepReport, Stopwatch, reported_tracks
from mmpf.stages.update_rule import Situation, UpdateRule
from mmpf.surroundings.on_road import on_road
from mmpf.tracks import Tracks
from mmpf.visibility.range_profile import Reach

RULES: dict[UpdateName, Callable[[FilterOptions, SensorModel], UpdateRule]] = {
    "joint": JointUpdate,
    "max_likelihood": MaxLikelihoodUpdate,
}


class MixtureTracker:
    """Tracks all vehicles in sensor range at once; each is a mixture component made of particles.

    Example:
        >>> tracker = MixtureTracker(road, sensor_model, motion_models["cvm"](), np.random.default_rng(0))
        >>> for scan in scans:
        ...     tracks = tracker.step(scan)
    """

    def __init__(
        self,
        road: Road,
        sensor: SensorModel,
        motion: MotionModel,
        rng: np.random.Generator,
        options: FilterOptions | None = None,
        proposal: Proposal = bootstrap_proposal,
    ) -> None:
        """Prepare a filter that has seen nothing yet.

        Args:
            road: The lanes, known beforehand.
            sensor: The sensor's data sheet.
            motion: How vehicles move.
            rng: The filter's own stream of randomness.
            options: Settings; the defaults track well.
            proposal: What new states are drawn from; the prior by default.
        """
        self._road, self._sensor, self._rng = road, sensor, rng
        self._on_road = on_road(road)
        self._options = self._on_road.options(options or FilterOptions())
        self._proposal = proposal
        self._rule = RULES[self._options.update](self._options, sensor)
        self._motion = self._on_road.motion(self._rule.motion(motion))
        self._error = self._rule.model_error(self._motion)
        self._mixture = Mixture.empty(self._motion.latent_size, self._rule.first(0), road.has_headings)
        self._moments = component_moments(self._mixture)
        self._previous: Scan | None = None
        self.last_report = StepReport()

    @property
    def mixture(self) -> Mixture:
        """The belief after the last scan; the next step writes over its latents."""
        return self._mixture

    @property
    def rule(self) -> UpdateRule:
        """The update rule, with what it has learned."""
        return self._rule

    @property
    def reach(self) -> Reach:
        """What was learned of how well the sensor sees at each distance."""
        return self._rule.reach

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the confirmed and tentative tracks after it.

        Args:
            scan: Detections, ego pose and time.

        Raises:
            InvalidScanError: The scan holds impossible values or is not later than the one before; the filter is
                as it was.
        """
        check_scan(scan, None if self._previous is None else self._previous.time_s, self._road.signals)
        scan = self._rule.prepare(scan)
        clock = Stopwatch()
        if self._previous is None:
            self._mixture = self._initialise(scan)
            self._moments = component_moments(self._mixture)
            self.last_report = StepReport(components=len(self._mixture), births=len(self._mixture))
        else:
            situation = self._situation(scan, self._previous)

            prior = self._prior_update(situation, self._previous)
            clock.lap("prior update")
            moments = component_moments(prior)
            occlusion = self._rule.assert_occlusion(prior, moments, situation)
            clock.lap("occlusion assertion")
            updated = self._rule.measurement_update(prior, moments, occlusion, situation, self._rng)
            clock.lap("measurement update")
            change = self._rule.remove_add_merge(updated, situation, self._rng)
            clock.lap("remove, add, merge")
            finetuned = self._rule.finetune(change.mixture, change.moments, situation, self._rng)
            clock.lap("finetune")
            self._mixture = self._rule.weight_update(finetuned.mixture)
            self._moments = finetuned.moments or component_moments(self._mixture)
            clock.lap("weight update")

            self.last_report = StepReport(
                components=len(self._mixture),
                effective_share=updated.effective_share,
                births=change.added,
                deaths=change.removed,
                merges=change.merged,
                reclusterings=finetuned.settled,
                association_entropy=updated.association_entropy,
                stage_ms=clock.laps_ms,
            )
        self._previous = scan
        return self._tracks()

    def _initialise(self, scan: Scan) -> Mixture:
        """Draw particles around the detections of the first scan: "Initialization"."""
        traffic = Traffic(np.array([scan.ego.lon_m]), np.array([scan.ego.speed_mps]))
        chosen = np.flatnonzero(~lies_on_ego(scan.detections, SensorPlane(scan.ego, self._road)))
        births = Births(scan.detections, chosen, self._rule.first(len(chosen)), traffic)
        none = np.zeros(0, dtype=np.bool_)
        return self._rule.weight_update(give_birth(self._mixture, none, births, self._motion, self._options, self._rng))

    def _tracks(self) -> Tracks:
        """Report the belief; of the ways that a vehicle may have taken unseen the heaviest."""
        reported = self._on_road.reported(self._mixture, self._moments)
        return reported_tracks(*reported, self._options.reporting, self._sensor)

    def _situation(self, scan: Scan, previous: Scan) -> Situation:
        known = self._moments.mean[:, self._mixture.components.confirmed & self._is_seen]
        place = np.column_stack([known[[LON, LAT]], (scan.ego.lon_m, scan.ego.lat_m)])
        traffic = self._on_road.traffic(place, np.append(known[SPEED], scan.ego.speed_mps))
        plane = SensorPlane(scan.ego, self._road)
        # Times are known to the microsecond, so their differences are rounded to it.
        dt_s = round(scan.time_s - previous.time_s, 6)
        return Situation(scan, self._sensor, self._motion, dt_s, traffic, plane)

    def _prior_update(self, situation: Situation, previous: Scan) -> Mixture:
        """Let every particle move on its own, given road and traffic as they were: "Prior update"."""
        belief = self._mixture, self._moments, self._is_seen
        surroundings = self._on_road.surroundings(belief, previous, situation.scan)
        return prior_update(self._mixture, surroundings, situation, self._proposal, self._error, self._rng)

    @property
    def _is_seen(self) -> BoolArray:
        return self._mixture.components.unseen_s <= self._options.reporting.hidden_after_s
