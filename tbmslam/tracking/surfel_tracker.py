"""Our way to follow the robot: lay each scan onto the surfaces of earlier keyframes, below the size of a cell."""

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
from pydantic import Field

from tbmslam.evidence_grid import EvidenceGrid
from tbmslam.frozen_config import FrozenConfig
from tbmslam.laser_scan import Hits, LaserScan
from tbmslam.scan_matching.scan_match import ScanMatch
from tbmslam.se2 import SE2, FloatArray, wrap_angle
from tbmslam.tracking.seen_space import SeenSpace, may_walk, small_things
from tbmslam.tracking.surfel_map import Registration, SurfelConfig, SurfelMap
from tbmslam.tracking.tracker import Since

_SURE = 3.0  # [deviations]
_HELD = np.array([1e-4, 1e-4, 1e-5])
"""Deviations [m, m, rad] with which a scan stays where it is."""


class SurfelTrackerConfig(FrozenConfig):
    """Our way: lay each scan onto the surfaces of earlier keyframes, below the size of a cell."""

    kind: Literal["surfels"] = "surfels"
    surfels: SurfelConfig = SurfelConfig()
    max_points: int = Field(400, ge=10, description="hits of a scan that are matched, evenly chosen")
    max_range: float = Field(40.0, gt=0, description="hits beyond this are neither matched nor learnt [m]")
    independent_points: float = Field(
        40.0, gt=0, description="how many independent hits a whole scan counts for, against the odometry"
    )
    tolerances: tuple[float, ...] = Field(
        (12.0, 4.0), description="distances at which a hit loses its say [deviations]"
    )
    iterations: int = Field(8, ge=1, description="Gauss-Newton steps for each tolerance, at the most")
    min_matched: float = Field(
        0.1, ge=0, le=1, description="share of hits on known surfaces below which odometry rules"
    )
    doubtful: float = Field(
        0.55, ge=0, le=1, description="share of hits on known surfaces below which to search around"
    )
    search_gain: float = Field(0.15, ge=0, le=1, description="how much more a search must match to be believed")
    search_costs: tuple[float, float] = Field(
        (0.2, 0.05), description="share of hits that a metre and a radian away from the guess must win"
    )
    search_points: int = Field(120, ge=10, description="hits that are tried in a search")
    search_shift: float = Field(0.5, ge=0, description="how far to search [m]")
    search_turn: float = Field(1.0, ge=0, description="how far to search [rad]")
    search_rest: int = Field(5, ge=0, description="doubtful scans after a search in vain that are not searched for")
    window: float = Field(15.0, gt=0, description="travelled length that the surfaces reach back, at least [m]")
    seen_scans: int = Field(10, ge=1, description="last keyframes whose empty space is remembered: what walks in moves")
    seen_depth: float = Field(0.5, gt=0, description="how far they went on behind what now stands there [m]")
    walking: float = Field(
        0.02,
        ge=0,
        le=1,
        description="share of hits that move from which on a keyframe asks the odometry since the last",
    )
    novel: float = Field(0.6, ge=0, le=1, description="share of hits on known surfaces below which a scan is learnt")


class SurfelTracker:
    """Registers scans on a surfel map."""

    def __init__(self, config: SurfelTrackerConfig) -> None:
        self._config = config
        self.grid: EvidenceGrid | None = None
        self.sees_walkers = False
        # Once it reaches back far enough, a map of the recent part of what is in it takes its place.
        self._map = SurfelMap(config.surfels)
        self._recent: list[tuple[Hits, SE2]] = []
        self._space = SeenSpace(config.seen_scans, config.seen_depth)
        self._travelled = 0.0
        self._last: SE2 | None = None
        self._seen: tuple[LaserScan, Hits] | None = None
        self._rest, self._in_vain = 0, 1.0
        self._doubted = 0  # keyframes for which the odometry is not believed where nobody is seen to walk
        self._tolerances = np.array(config.tolerances)
        self._reach = round(config.search_shift / config.surfels.resolution)
        self._search_turns = np.arange(-config.search_turn, config.search_turn + 1e-9, 0.03)

    def match(self, scan: LaserScan, guess: SE2, deviations: FloatArray, other_guess: Callable[[], SE2]) -> ScanMatch:
        """Lay the scan onto the surfaces; directions that they leave open keep the guess."""
        config = self._config
        hits = self._hits_of(scan)
        if self.sees_walkers:
            still = self._space.standing(hits, guess)
            hits = still if len(still.points) else hits
        if not len(hits.points) or deviations[0] == 0.0:  # nothing to see, or the first scan, which lies where it lies
            return ScanMatch(guess, 0.0, moved=False)
        result = self._register(hits, guess, deviations)
        if result.matched >= config.doubtful:
            self._rest = 0
        elif self._is_worth_a_search(result):
            result = self._searched(hits, guess, other_guess(), deviations, result)
        if result.matched < config.min_matched:
            return ScanMatch(guess, result.matched, moved=False)
        return _match_of(result)

    def _is_worth_a_search(self, result: Registration) -> bool:
        """Tell whether a doubtful scan should be searched for.

        Where much is new, one scan after the other is doubtful, and what was searched for in vain is for the next one,
        too; only after a slip a scan matches worse than the one before.
        """
        self._rest -= 1
        return self._rest < 0 or result.matched < self._in_vain - self._config.search_gain / 3.0

    def _searched(
        self, hits: Hits, guess: SE2, other_guess: SE2, deviations: FloatArray, result: Registration
    ) -> Registration:
        """Return the best of a result and of what searches around two guesses find, if that is much better."""
        config, best = self._config, result
        for start in (guess,) if self._is_near(guess, other_guess) else (guess, other_guess):
            other = self._register(hits, self._search(hits, start), deviations)
            if other.matched > best.matched + config.search_gain:
                best = other
        self._rest, self._in_vain = (config.search_rest, result.matched) if best is result else (0, 1.0)
        return best

    def settled(self, scan: LaserScan, match: ScanMatch, since: Since | None) -> ScanMatch:
        """Return where a scan was taken around which people walk.

        Who goes along with the robot holds it back a little from scan to scan, most where walls leave the way open. The
        odometry since the last keyframe is not held back. It is believed where what stands still fits as well; it may
        fit worse by as much as is seen to move, since of those who go ahead nobody saw the place empty before. Walls
        tell the heading in any case. Without odometry there is nothing to believe, and nobody is looked for.

        Where the scan was found nobody may seem to walk, since those who walk hold it back until they stand still. Then
        things as small as people must walk where the odometry says it is, which must have been right of late: from a
        wrong place walls would seem to walk, too. Or nobody saw them walk, as they were close around from the start.
        """
        self.sees_walkers = False
        if since is None:
            self._doubted = self._config.seen_scans if self._last is not None else 0
            return match
        hits, found = self._hits_of(scan), match.T_map_sensor
        most = (1.0 - self._config.walking) * len(hits.points)
        self.sees_walkers = len(self._space.standing(hits, found).points) < most
        there, deviations = since()
        guess = SE2(there.x, there.y, found.theta)
        may_hold_back = self._may_hold_back(found, there, deviations)
        settled: ScanMatch | None = None
        if self.sees_walkers or (may_hold_back and may_walk(hits.points[self._space.in_seen_space(hits, guess)])):
            settled = self._among_walkers(hits, found, guess, deviations)
        if settled is None and may_hold_back:
            settled = self._among_things(hits, found, guess, deviations)
        self.sees_walkers |= settled is not None
        return settled or match

    def _among_walkers(self, hits: Hits, found: SE2, guess: SE2, deviations: FloatArray) -> ScanMatch | None:
        """Return where the odometry says that a scan was taken, if what stands still fits there as well."""
        still = self._space.standing(hits, guess)
        # From a wrong place walls, too, seem to stand where nothing was.
        if not 0 < len(still.points) < (1.0 - self._config.walking) * len(hits.points):
            return None
        moving = 1.0 - len(still.points) / len(hits.points)
        by_odometry = self._register(still, guess, deviations)
        if by_odometry.matched < self._register(still, found, _HELD).matched - moving:
            return None
        return _match_of(by_odometry)

    def _among_things(self, hits: Hits, found: SE2, guess: SE2, deviations: FloatArray) -> ScanMatch | None:
        """Return where the odometry says that a scan was taken, if only what may be people says otherwise.

        What is as small as people may all walk. They hold the robot back where the odometry is ahead by more than it
        errs, they fit worse where it says, and all else fits better. Where it is ahead by far more than it errs, all
        else may fit worse by as much as they hide: nobody saw the walls behind them before. Where furniture tells of
        wheels that slip, all else tells it, too.
        """
        is_thing = small_things(hits.points)
        rest, things, share = hits.chosen(~is_thing), hits.chosen(is_thing), is_thing.mean()
        ahead = math.hypot(guess.x - found.x, guess.y - found.y) / deviations[0]
        if ahead < 1.0 or not len(rest.points) or share < self._config.walking:
            return None
        by_odometry = self._register(rest, guess, deviations)
        better = by_odometry.matched - self._register(rest, found, _HELD).matched
        if better < (-share if ahead > _SURE else self._config.walking):
            return None
        if self._register(things, by_odometry.pose, _HELD).matched >= self._register(things, found, _HELD).matched:
            return None
        return _match_of(by_odometry)

    def _may_hold_back(self, found: SE2, there: SE2, deviations: FloatArray) -> bool:
        """Tell whether who goes along may be all that keeps a scan from where the odometry says it is.

        They make the way shorter, and leave the heading to the walls. An odometry that goes less far than the scans,
        or turns otherwise, is wrong itself, and doubted until no scan of that time is remembered.
        """
        before = self._last
        if before is None:
            return False
        by_scans, by_wheels = before.to(found), before.to(there)
        apart = math.hypot(by_wheels.x, by_wheels.y) - math.hypot(by_scans.x, by_scans.y)
        turn = abs(wrap_angle(by_wheels.theta - by_scans.theta))
        if turn > _SURE * deviations[2] or apart < -_SURE * deviations[0]:
            self._doubted = self._config.seen_scans
        elif self._doubted:
            self._doubted -= 1
        return not self._doubted and apart > 0.0

    def _hits_of(self, scan: LaserScan) -> Hits:
        """Return a scan's hits; a scan is first placed and then learnt from, so the last one's are remembered."""
        if self._seen is None or self._seen[0] is not scan:
            self._seen = scan, scan.hits(self._config.max_range)
        return self._seen[1]

    def _is_near(self, guess: SE2, other_guess: SE2) -> bool:
        """Tell whether a search around one guess covers the other's well enough."""
        apart = guess.to(other_guess)
        config = self._config
        return math.hypot(apart.x, apart.y) < 0.3 * config.search_shift and abs(apart.theta) < 0.3 * config.search_turn

    def _search(self, hits: Hits, guess: SE2) -> SE2:
        config = self._config
        few = hits.thinned(config.search_points)
        turns, tolerance = self._search_turns, config.tolerances[0]
        return self._map.search(few, guess, self._reach, turns, tolerance, config.search_costs)

    def _register(self, hits: Hits, guess: SE2, deviations: FloatArray) -> Registration:
        config = self._config
        say = config.independent_points
        every = max(len(hits.points) // config.max_points, 1)
        return self._map.register(hits, guess, deviations, say, self._tolerances, config.iterations, every)

    def revised_poses(self) -> FloatArray | None:
        """Leave what was tracked as it is."""
        return None

    def is_novel(self, match: ScanMatch) -> bool:
        """Tell whether much of the scan lies where no surface is known yet."""
        return match.score < self._config.novel

    def learn(self, scan: LaserScan, match: ScanMatch) -> None:
        """Add those of the scan's hits that do not move to the surfaces, and let old ones go."""
        pose = match.T_map_sensor
        if self._last is not None:
            self._travelled += math.hypot(pose.x - self._last.x, pose.y - self._last.y)
        self._last = pose
        if self._travelled > self._config.window:
            self._map = SurfelMap(self._config.surfels)
            self._map.insert(Hits.joined([hits.placed(there) for hits, there in self._recent]), SE2.identity())
            self._recent.clear()
            self._travelled = 0.0
        hits = self._space.still(self._hits_of(scan), pose)
        self._map.insert(hits, pose)
        self._recent.append((hits, pose))


def _match_of(result: Registration) -> ScanMatch:
    return ScanMatch(result.pose, result.matched, moved=True, information=result.hessian)
