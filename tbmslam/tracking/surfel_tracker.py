"""Registers each scan on the surfels of earlier keyframes, with errors far below the size of a cell."""

import math
from collections.abc import Callable, Sequence
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.kernels.surfels.determined import prior_information
from tbmslam.kernels.surfels.outline import Outline, outline_of
from tbmslam.kernels.surfels.surfel_alignment import Search
from tbmslam.sensing.laser_scan import Hits, LaserScan
from tbmslam.tracking.fit_by_chance import misfit_cost
from tbmslam.tracking.odometry_fault import RESTART_COST, OdometryFault, faulty_cost
from tbmslam.tracking.odometry_noise import Deviations
from tbmslam.tracking.scan_to_scan import RecentScans, ScanMotion
from tbmslam.tracking.student_t import FREEDOM, student_cost, student_weight
from tbmslam.tracking.surfel_map import Registration, SurfelConfig, SurfelMap
from tbmslam.tracking.tracker import Coasting, PosePrior, ScanMatch

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
_SWERVE = 0.1
"""A step of the odometry that differs more from the robot's last motion may be a fault: registration converges from no
farther away [m]. Inertia counts only then, since the last poses may be wrong if people walk beside the robot. With
0.05 the error in a simulated hospital with a crowd is 0.2 m instead of 0.02 m."""
_CERTAIN = 2.0
"""The certain share of a scan is its estimate minus this number of standard deviations. Lasers with few hits need a
denser map: with 0 the drive with a range of 1 m (`weak-lasers`) errs by 0.15 m instead of 0.03 m."""
_SAME_START = 0.05
"""Starts that are nearer to each other need one search, which covers half a metre around [m], [rad]."""
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


class _PoseBelief(NamedTuple):
    """A belief about the laser's pose in the map's frame, of Student's t distribution."""

    mean: SE2
    information: FloatArray
    """Inverse scale (3, 3)."""

    @classmethod
    def of(cls, T_map_robot: SE2, deviations: Deviations, T_robot_sensor: SE2) -> "_PoseBelief":
        """Return the belief about the laser's pose by the robot's pose and its deviations (along, across, heading)."""
        mount = (*T_robot_sensor,)
        return cls(T_map_robot @ T_robot_sensor, prior_information(deviations, T_map_robot.theta, mount))

    def squared_distance(self, pose: SE2) -> float:
        """Return the squared Mahalanobis distance of a pose from the mean."""
        (x, y, theta), mean = pose, self.mean
        error = np.array([x - mean.x, y - mean.y, wrap_angle(theta - mean.theta)])
        return float(error @ self.information @ error)

    def is_near(self, other: "_PoseBelief") -> bool:
        """Return whether a search about one mean includes the other."""
        apart = self.mean.to(other.mean)
        return math.hypot(apart.x, apart.y) < _SAME_START and abs(apart.theta) < _SAME_START


class _Returned(NamedTuple):
    """The laser's pose by odometry that is again as before a fault."""

    belief: _PoseBelief
    dearer: float
    """Cost of the mean, less that of the mean of right odometry."""

    def cost(self, pose: SE2) -> float:
        """Return the negative log-likelihood of a pose, less that of the mean of right odometry."""
        return self.dearer + student_cost(self.belief.squared_distance(pose))


class SurfelTracker:
    """Registers scans on a surfel map."""

    def __init__(self, config: SurfelTrackerConfig) -> None:
        self._config = config
        self.grid: EvidenceGrid | None = None
        # When it reaches back far enough, a map of its recent part replaces it.
        self._map = SurfelMap(config.surfels)
        self._recent: list[tuple[Hits, SE2]] = []
        self._travelled = 0.0
        self._last: SE2 | None = None
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
        hits = np.empty((2, len(scan.ranges), 2))
        result, count = self._map.place(scan, config.max_range, prior, T_robot_sensor, self._search, hits)
        self._seen = scan, hits, count
        if not prior.by_odometry:
            self._fault.forget()
        if not prior.by_odometry and result.matched < config.doubtful:
            guess = prior.mean @ T_robot_sensor
            between = self._scans_before.place(scan.stamp, self._hits_of(scan).points, guess)
            if between is not None:
                prior = _by_scans(prior, between, T_robot_sensor)
                result, _ = self._map.place(scan, config.max_range, prior, T_robot_sensor, self._search, hits)
        is_surprising = result.surprise > _SURPRISING or self._may_be_faulty(prior)
        faulty, returned = math.inf, None  # Odometry that neither surprises nor is suspected is right.
        if is_surprising or result.matched < config.doubtful:
            coasting = prior.coasting()
            if coasting is not None:
                faulty = faulty_cost(prior.deviations, coasting.deviations)
            returned = self._returned(prior, T_robot_sensor)
            result = self._elsewhere(self._hits_of(scan), prior, coasting, faulty, returned, T_robot_sensor, result)
        is_lost = _is_lost(result) and (between is None or not between.is_likely)
        # Within a loose prior, such as after a gap in the scans, some hits fit by chance.
        is_by_chance = prior.by_odometry and prior.is_loose() and _least_share(result) < _FEW
        if result.matched < config.min_matched or is_by_chance:
            return _unmatched(result, prior, between, T_robot_sensor, is_lost or is_by_chance)
        if prior.by_odometry:
            costs = result.surprise, faulty, math.inf if returned is None else returned.cost(result.pose)
            self._surprise = costs, (prior, T_robot_sensor, result.pose)
        trust = _LOST_TRUST if is_lost else student_weight(result.surprise, 3)
        return ScanMatch(result.pose, _least_share(result), True, result.hessian, trust, is_lost)

    def _elsewhere(
        self,
        hits: Hits,
        prior: PosePrior,
        coasting: Coasting | None,
        faulty: float,
        returned: _Returned | None,
        T_robot_sensor: SE2,
        result: Registration,
    ) -> Registration:
        """Return the hypothesis with the largest posterior: the given registration, or one from another start."""
        if not len(hits.points):
            return result
        predicted = _PoseBelief.of(prior.mean, prior.deviations, T_robot_sensor)
        inertia = None if coasting is None else _PoseBelief.of(*coasting, T_robot_sensor)
        may_be_faulty = self._may_be_faulty(prior)

        def cost(registration: Registration) -> float:
            """Return the negative logarithm of the posterior, up to a constant."""
            pose, surprise = registration.pose, registration.surprise
            tolerance, outline = self._config.tolerances[-1], self._outline_of_keyframe()
            cost = misfit_cost(*self._map.known_hits(hits, pose, _THING, tolerance, outline))
            if not may_be_faulty or (inertia is None and returned is None):
                return cost + student_cost(surprise)
            cost += self._fault.cost(surprise, faulty, math.inf if returned is None else returned.cost(pose))
            return cost if inertia is None else cost + student_cost(inertia.squared_distance(pose))

        def registered(belief: _PoseBelief, start: SE2, search: Search, known: Registration) -> list[Registration]:
            """Return the registration with a prior; none where it ends at a known one."""
            found = self._map.register(hits, start, *belief, search, known.pose)
            if found.matched < 0.0:
                return []
            return [found if belief is predicted else found._replace(surprise=predicted.squared_distance(found.pose))]

        # If people walk along or a slip begins, the scan fits twice: to objects that move with the robot, and to walls.
        others = registered(predicted, predicted.mean, self._narrow, result) if prior.by_odometry else []
        other = inertia or predicted
        others += registered(other, other.mean, self._search, result)
        if returned is not None:
            others += registered(returned.belief, returned.belief.mean, self._search, result)
        least, best = _cheapest([result, *others], cost) if others else (None, result)
        if best.matched >= self._config.doubtful:
            self._rest = 0
            return best
        self._rest -= 1
        if self._rest < 0 or best.matched < self._in_vain - 0.05:
            beliefs = [predicted] if inertia is None or predicted.is_near(inertia) else [predicted, inertia]
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

    def _returned(self, prior: PosePrior, T_robot_sensor: SE2) -> _Returned | None:
        """Return the pose if the odometry began anew, or is again as before a fault; None if neither is suspected."""
        if prior.stood is not None:
            (pose, deviations), cost = prior.stood, RESTART_COST
        elif prior.by_odometry and (found := self._fault.returned(prior.mean, prior.deviations)) is not None:
            (pose, deviations), cost = found, 0.0
        else:
            return None
        dearer = cost + math.log(math.prod(deviations) / math.prod(prior.deviations))
        return _Returned(_PoseBelief.of(pose, deviations, T_robot_sensor), dearer)

    def _outline_of_keyframe(self) -> Outline:
        """Return the outline of the last keyframe."""
        if self._keyframe is None:
            return np.empty((0, 5)), 0.0, 1.0, (0.0, 0.0, 0.0)
        if self._outline is None:
            scan, pose = self._keyframe
            view = scan.angle_min, scan.angle_increment + scan.beam_step.theta, (*pose,)
            self._outline = outline_of(scan.ranges, *view), *view
        return self._outline

    def _may_be_faulty(self, prior: PosePrior) -> bool:
        """Return whether the odometry suddenly leaves the robot's last motion, or was faulty a short time ago."""
        return prior.swerve > _SWERVE or prior.stood is not None or self._fault.is_suspected

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
        return self._map.search(few, guess, self._reach, turns, tolerance, (0.2, 0.05))

    def is_novel(self, match: ScanMatch) -> bool:
        """Return whether a large share of the scan may be unknown so far."""
        return match.score < self._config.novel

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        """Add the hits of the scan to the surfels, and drop old surfels."""
        pose = match.T_map_sensor
        if self._last is not None:
            self._travelled += math.hypot(pose.x - self._last.x, pose.y - self._last.y)
        self._last = pose
        if self._travelled > self._config.window:
            # The new map will be as large as the old map.
            self._map = SurfelMap(self._config.surfels, slots=self._map.slots)
            for recent in self._recent:
                self._map.insert(*recent)
            self._recent.clear()
            self._travelled = 0.0
        if self._surprise is not None:
            costs, (prior, T_robot_sensor, by_scan) = self._surprise
            self._fault.observe(*costs)
            self._fault.remember(prior.mean @ T_robot_sensor, by_scan, prior.deviations)
        hits = self._hits_of(scan)
        self._map.insert(hits, pose)
        self._recent.append((hits, pose))
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
