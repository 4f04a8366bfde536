"""Registers each scan on the surfels of earlier keyframes, with errors far below the size of a cell."""

import math
from collections.abc import Callable, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray
from tbmslam.kernels.surfels.outline import Outline, outline_of
from tbmslam.kernels.surfels.surfel_alignment import Search
from tbmslam.sensing.laser_scan import Hits, LaserScan
from tbmslam.tracking.fit_by_chance import misfit_cost
from tbmslam.tracking.local_surfels import LocalSurfels
from tbmslam.tracking.odometry_fault import OdometryFault
from tbmslam.tracking.odometry_hypotheses import OdometryHypotheses, PoseBelief, may_be_faulty
from tbmslam.tracking.scan_to_scan import RecentScans, ScanMotion
from tbmslam.tracking.student_t import FREEDOM, student_weight
from tbmslam.tracking.surfel_map import Registration, SurfelConfig
from tbmslam.tracking.tracker import PosePrior, ScanMatch

_THING = 0.5
"""Hits within this length of surface count as one object, such as a person [m]. With 0.1 m, the scale at which hit
errors are correlated, the drive is metres too short if five people walk beside the robot along a corridor."""
_FEW, _MANY = 0.2, 15.0
"""A scan is lost if a smaller share of it fits and more independent hits fit nothing: the robot is elsewhere, or the
place has changed. Four good indoor drives stay above a share of 0.4."""
_LOST_TRUST = 0.01
"""Weight of the odometry's information at a lost scan: loop closures may move the rest of the drive by ten times its
standard deviations."""
_SURPRISING = 72.8
"""Squared Mahalanobis distance from the prior beyond which other hypotheses are tried: Student's t distribution of
three dimensions exceeds it in 0.5 %. With the 12.8 of a normal distribution, mapping mit-csail takes a tenth longer."""
_CERTAIN = 2.0
"""The certain share of a scan is its estimate minus this number of standard deviations. Lasers with few hits need a
denser map: with 0 the drive with a range of 1 m (`weak-lasers`) errs by 0.15 m instead of 0.03 m."""
_WORTHWHILE = 1.0
"""Smallest gain in log-likelihood for which a search replaces a pose."""


class SurfelTrackerConfig(FrozenConfig):
    """Registration of each scan on the surfels of earlier keyframes."""

    PUBLIC: ClassVar = ("kind", "max_range")

    kind: Literal["surfels"] = "surfels"
    surfels: SurfelConfig = SurfelConfig()
    max_points: int = Field(
        400, ge=10, description="least number of hits of a scan that are matched, evenly chosen, if it has as many"
    )
    max_range: float = Field(40.0, gt=0, description="hits beyond this range are neither registered nor learnt [m]")
    correlation_length: float = Field(
        0.1, gt=0, description="length of surface within which hits err alike and count as one [m]"
    )
    tolerances: tuple[float, ...] = Field(
        (12.0, 4.0), description="distances at which a hit loses its influence [deviations]"
    )
    iterations: int = Field(8, ge=1, description="Gauss-Newton steps for each tolerance, at the most")
    min_matched: float = Field(
        0.1, ge=0, le=1, description="share of hits on known surfaces below which the prior alone places a scan"
    )
    doubtful: float = Field(
        0.55, ge=0, le=1, description="share of hits on known surfaces below which to search elsewhere"
    )
    search_points: int = Field(60, ge=10, description="hits that are tried in a search")
    search_shift: float = Field(0.5, ge=0, description="how far to search [m]")
    search_turn: float = Field(1.0, ge=0, description="how far to search [rad]")
    search_rest: int = Field(5, ge=0, description="doubtful scans after a search in vain that are not searched for")
    window: float = Field(15.0, gt=0, description="travelled length that the surfaces reach back, at least [m]")
    novel: float = Field(
        0.4,
        ge=0,
        le=1,
        description="a scan of which a smaller share is certainly known is learnt even if the robot hardly moved",
    )


class SurfelTracker:
    """Registers scans on a surfel map."""

    def __init__(self, config: SurfelTrackerConfig) -> None:
        self._config = config
        self.grid: EvidenceGrid | None = None
        self._local = LocalSurfels(config.surfels, config.window)
        # The last scan, its hits in an array with room for more, and how many they are.
        self._seen: tuple[LaserScan, FloatArray, int] | None = None
        self._keyframe: tuple[LaserScan, SE2] | None = None
        self._outline: Outline | None = None  # of the last keyframe, once it was asked for
        self._rest, self._in_vain = 0, 1.0
        self._scans_before = RecentScans()
        self._fault = OdometryFault()
        # Of the last scan, where odometry and scan both place it: arguments of `OdometryFault.observe`, and both poses.
        self._surprise: tuple[tuple[float, float, float], tuple[PosePrior, SE2, SE2]] | None = None
        tolerances = np.array(config.tolerances)
        self._search = FREEDOM, config.correlation_length, math.inf, tolerances, config.max_points, config.iterations
        self._narrow = *self._search[:3], tolerances[-1:], *self._search[4:]
        self._reach = round(config.search_shift / config.surfels.resolution)
        self._search_turns = np.arange(-config.search_turn, config.search_turn + 1e-9, 0.03)

    def match(self, scan: LaserScan, prior: PosePrior, T_robot_sensor: SE2) -> ScanMatch:
        """Register the scan; directions that the surfaces do not determine keep the prior's mean."""
        match = self._match(scan, prior, T_robot_sensor)
        if not prior.by_odometry:
            self._scans_before.remember(scan.stamp, self._hits_of(scan).points, match.T_map_sensor)
        return match

    def _match(self, scan: LaserScan, prior: PosePrior, T_robot_sensor: SE2) -> ScanMatch:
        """Register the scan. Without odometry, a scan that fits badly takes its prior from the last scans."""
        config, between = self._config, None
        self._surprise = None
        if prior.deviations[0] == 0.0:  # the first scan defines the frame
            self._seen = None
            return ScanMatch(prior.mean @ T_robot_sensor, 0.0, moved=False)
        surfels, hits = self._local.map, np.empty((2, len(scan.ranges), 2))
        result, count = surfels.place(scan, config.max_range, prior, T_robot_sensor, self._search, hits)
        self._seen = scan, hits, count
        if not prior.by_odometry:
            self._fault.forget()
        if not prior.by_odometry and result.matched < config.doubtful:
            guess = prior.mean @ T_robot_sensor
            between = self._scans_before.place(scan.stamp, self._hits_of(scan).points, guess)
            if between is not None:
                prior = _by_scans(prior, between, T_robot_sensor)
                result, _ = surfels.place(scan, config.max_range, prior, T_robot_sensor, self._search, hits)
        costs = result.surprise, math.inf, math.inf  # Odometry that neither surprises nor is suspected is right.
        is_surprising = result.surprise > _SURPRISING or may_be_faulty(prior, self._fault)
        if is_surprising or result.matched < config.doubtful:
            hypotheses = OdometryHypotheses.of(prior, T_robot_sensor, self._fault)
            result = self._likeliest(self._hits_of(scan), hypotheses, result, by_odometry=prior.by_odometry)
            costs = hypotheses.costs(result.pose, result.surprise)
        is_lost = _is_lost(result) and (between is None or not between.is_likely)
        # Within a loose prior, such as after a gap in the scans, some hits fit by chance.
        is_by_chance = prior.by_odometry and prior.is_loose() and _least_share(result) < _FEW
        if result.matched < config.min_matched or is_by_chance:
            return _unmatched(result, prior, between, T_robot_sensor, is_lost or is_by_chance)
        if prior.by_odometry:
            self._surprise = costs, (prior, T_robot_sensor, result.pose)
        trust = _LOST_TRUST if is_lost else student_weight(result.surprise, 3)
        return ScanMatch(result.pose, _least_share(result), True, result.hessian, trust, is_lost)

    def _likeliest(
        self, hits: Hits, hypotheses: OdometryHypotheses, result: Registration, *, by_odometry: bool
    ) -> Registration:
        """Return the registration with the largest posterior: the given one, or one from another start."""
        if not len(hits.points):
            return result
        right, inertia, returned, *_ = hypotheses

        def cost(registration: Registration) -> float:
            """Return the negative logarithm of the posterior, up to a constant."""
            pose, tolerance = registration.pose, self._config.tolerances[-1]
            known, strays = self._local.map.known_hits(hits, pose, _THING, tolerance, self._outline_of_keyframe())
            return misfit_cost(known, strays) + hypotheses.cost(pose, registration.surprise, self._fault)

        def registered(belief: PoseBelief, start: SE2, search: Search, known: Registration) -> list[Registration]:
            """Return the registration with a prior; none where it ends at a known one."""
            found = self._local.map.register(hits, start, *belief, search, known.pose)
            if found.matched < 0.0:
                return []
            return [found if belief is right else found._replace(surprise=right.squared_distance(found.pose))]

        # If people walk along or a slip begins, the scan fits twice: to objects that move with the robot, and to walls.
        others = registered(right, right.mean, self._narrow, result) if by_odometry else []
        for belief in (inertia or right, returned):
            if belief is not None:
                others += registered(belief, belief.mean, self._search, result)
        least, best = _cheapest([result, *others], cost) if others else (None, result)
        if best.matched >= self._config.doubtful:
            self._rest = 0
            return best
        self._rest -= 1
        if self._rest < 0 or best.matched < self._in_vain - 0.05:
            beliefs = [right] if inertia is None or right.is_near(inertia) else [right, inertia]
            found = [
                registration
                for belief in beliefs
                for registration in registered(belief, self._best_near(hits, belief.mean), self._search, best)
            ]
            self._rest, self._in_vain = self._config.search_rest, best.matched
            if found:
                cost_found, cheapest = _cheapest(found, cost)
                if cost_found < (cost(best) if least is None else least) - _WORTHWHILE:
                    self._rest, self._in_vain, best = 0, 1.0, cheapest
        return best

    def _outline_of_keyframe(self) -> Outline:
        """Return the outline of the last keyframe."""
        if self._keyframe is None:
            return np.empty((0, 5)), 0.0, 1.0, (0.0, 0.0, 0.0)
        if self._outline is None:
            scan, pose = self._keyframe
            view = scan.angle_min, scan.angle_increment + scan.beam_step.theta, (*pose,)
            self._outline = outline_of(scan.ranges, *view), *view
        return self._outline

    def _hits_of(self, scan: LaserScan) -> Hits:
        """Return a scan's hits. Those of the last scan are remembered, since a scan is registered and then inserted."""
        if self._seen is None or self._seen[0] is not scan:
            return scan.hits(self._config.max_range)
        _, hits, count = self._seen
        return Hits(hits[0, :count], hits[1, :count])

    def _best_near(self, hits: Hits, guess: SE2) -> SE2:
        """Return the pose near a guess at which most hits lie on surfaces."""
        config = self._config
        few = hits.thinned(config.search_points)
        turns, tolerance = self._search_turns, config.tolerances[0]
        return self._local.map.search(few, guess, self._reach, turns, tolerance, (0.2, 0.05))

    def is_novel(self, match: ScanMatch) -> bool:
        """Return whether a large share of the scan may be unknown so far."""
        return match.score < self._config.novel

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        """Add the hits of the scan to the surfels, and drop old surfels."""
        pose = match.T_map_sensor
        if self._surprise is not None:
            costs, (prior, T_robot_sensor, by_scan) = self._surprise
            self._fault.observe(*costs)
            self._fault.remember(prior.mean @ T_robot_sensor, by_scan, prior.deviations)
        self._local.insert(self._hits_of(scan), pose)
        self._keyframe, self._outline = (scan, pose), None


def _cheapest(
    registrations: Sequence[Registration], cost: Callable[[Registration], float]
) -> tuple[float, Registration]:
    """Return the smallest cost of registrations, and the first one that has it."""
    costs = [cost(each) for each in registrations]
    least = min(costs)
    return least, registrations[costs.index(least)]


def _is_lost(result: Registration) -> bool:
    """Return whether hardly anything that the scan shows is known."""
    return result.matched < _FEW and result.independent * (1.0 - result.matched) > _MANY


def _unmatched(
    result: Registration, prior: PosePrior, between: ScanMotion | None, T_robot_sensor: SE2, is_lost: bool
) -> ScanMatch:
    """Return the prior's pose for a scan that hardly fits."""
    trust = _LOST_TRUST if is_lost else 1.0
    information = None if between is None else np.diag(trust * np.array(prior.deviations) ** -2.0)
    pose = prior.mean @ T_robot_sensor
    return ScanMatch(pose, result.matched, between is not None, information, trust, is_lost)


def _by_scans(prior: PosePrior, found: ScanMotion, T_robot_sensor: SE2) -> PosePrior:
    """Return the prior by the last scans; its deviations along and across are equal."""
    mean, (position, heading) = found.motion @ T_robot_sensor.inverse(), found.deviations
    return prior._replace(mean=mean, start=mean, deviations=(position, position, heading))


def _least_share(result: Registration) -> float:
    """Return a lower bound of the known share of the surroundings, by the number of independent hits."""
    _, _, share, independent, _ = result
    variance = share * (1.0 - share) / max(independent, 1.0)
    return share - _CERTAIN * math.sqrt(variance) if variance > 0.0 else share
