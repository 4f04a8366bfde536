"""Places seen again: found by search, verified, and the whole drive bent so that they coincide.

Stretches of the drive are joined into submaps. Wherever the drive may have come back, which a model of its drift says,
a bundle of neighbouring keyframes is searched for in the old submap, laid onto its surfaces and verified: most of it
must match, its surroundings must be distinctive, and both directions of the plane must be determined. Accepted closures
enter a robust pose graph.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from tbmslam.laser_scan import LaserScan
from tbmslam.pose_graph import MotionEdge, edge_error, optimise
from tbmslam.se2 import SE2, FloatArray
from tbmslam.submap import build_submap, split_into_submaps
from tbmslam.surfel_map import SurfelConfig

_log = logging.getLogger(__name__)


class LoopClosingConfig(BaseModel):
    """When a place is taken for one seen before."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    enabled: bool = Field(True, description="close loops at all")
    submap_length: float = Field(8.0, gt=0, description="travelled length of a submap [m]")
    min_gap: float = Field(12.0, gt=0, description="travelled length between two visits to a place [m]")
    reach: float = Field(4.0, gt=0, description="how near a keyframe must be to a submap's way [m]")
    bundle: float = Field(1.5, ge=0, description="keyframes within this length before and after join a search [m]")
    step: float = Field(1.0, gt=0, description="travelled length between keyframes that are searched for [m]")
    drift: float = Field(0.03, gt=0, description="position drift by travelled length, for the search window [m/m]")
    turn_drift: float = Field(0.006, gt=0, description="heading drift by travelled length [rad/m]")
    max_shift: float = Field(4.0, gt=0, description="largest search window [m]")
    max_turn: float = Field(0.5, gt=0, description="largest search window [rad]")
    min_matched: float = Field(0.65, ge=0, le=1, description="share of a bundle that must lie on the submap's surfaces")
    search_points: int = Field(150, ge=10, description="hits of a bundle used in a search")
    match_points: int = Field(500, ge=10, description="hits of a bundle laid onto the surfaces")
    min_determined: float = Field(0.02, ge=0, description="curvature of the weakest direction over the strongest")
    position_deviation: float = Field(0.02, gt=0, description="accuracy of a closure at best [m]")
    heading_deviation: float = Field(0.004, gt=0, description="accuracy of a closure at best [rad]")
    robust_width: float = Field(2.0, gt=0, description="deviations at which a closure begins to lose its say")
    max_range: float = Field(40.0, gt=0, description="hits beyond this are not used [m]")
    coarse: SurfelConfig = SurfelConfig(resolution=0.3, noise=0.1, point_size=0.1, clutter=0.3, certain_hits=4.0)


@dataclass(frozen=True)
class Candidate:
    """A keyframe that may see a submap again, and how far both may have drifted apart."""

    keyframe: int
    submap: int
    shift: float
    turn: float


class LoopCloser:
    """Finds closures in a drive and returns the drive corrected.

    Parameters
    ----------
    config
        When a place is taken for one seen before.
    surfels
        What makes a surface.
    """

    def __init__(self, config: LoopClosingConfig, surfels: SurfelConfig) -> None:
        self._config = config
        self._surfels = surfels

    def close(
        self, poses: FloatArray, scans: Sequence[LaserScan], chain: Sequence[MotionEdge]
    ) -> tuple[FloatArray, list[MotionEdge]]:
        """Return the corrected poses (N, 3) of the laser at every keyframe, and the closures that corrected them.

        Parameters
        ----------
        poses
            Poses (N, 3) of the laser as tracked.
        scans
            The keyframes' scans.
        chain
            Motions between consecutive keyframes.
        """
        points = [scan.hit_points(self._config.max_range) for scan in scans]
        drive = _Drive(self._config, self._surfels, poses, points, list(chain))
        drive.search_forward()
        for _ in range(2):
            drive.tighten()
        _log.info("%d closures between %d keyframes", len(drive.closures), len(poses))
        return drive.poses, drive.closures


class _Drive:
    """One drive being corrected."""

    def __init__(
        self,
        config: LoopClosingConfig,
        surfels: SurfelConfig,
        poses: FloatArray,
        points: Sequence[FloatArray],
        chain: list[MotionEdge],
    ) -> None:
        self.config = config
        self.poses = poses.copy()
        self.tracked = poses
        self.points = points
        self.chain = chain
        self.closures: list[MotionEdge] = []
        self.submaps = [
            build_submap(first, last, poses, points, surfels, config.coarse)
            for first, last in split_into_submaps(poses, config.submap_length)
        ]
        self.travelled = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))

    def search_forward(self) -> None:
        """Follow the drive in time and close what it comes back to, correcting at once what follows."""
        due = 0.0
        for keyframe in range(len(self.poses)):
            if self.travelled[keyframe] < due:
                continue
            due = self.travelled[keyframe] + self.config.step
            found = [edge for c in self._candidates(keyframe) if (edge := self._closure(c)) is not None]
            if found:
                surprise = max(edge_error(edge, self.poses) for edge in found)
                self.closures += found
                if surprise > 1.0:
                    self._optimise()
        self._optimise()

    def tighten(self) -> None:
        """Search once more around the corrected poses, now that they are nearly right, and drop what disagrees."""
        self.closures = []
        due = 0.0
        for keyframe in range(len(self.poses)):
            if self.travelled[keyframe] < due:
                continue
            due = self.travelled[keyframe] + 0.5 * self.config.step
            for submap in self._reachable(keyframe, 0.5):
                edge = self._closure(Candidate(keyframe, submap, 0.15, 0.02))
                if edge is not None:
                    self.closures.append(edge)
        self._optimise()

    def _optimise(self) -> None:
        if self.closures:
            self.poses = optimise(self.poses, self.chain, self.closures, self.config.robust_width)

    def _candidates(self, keyframe: int) -> list[Candidate]:
        """Return the old submaps that a keyframe may see, nearest first, with the drift since."""
        config = self.config
        distances = self._graph_distances(keyframe)
        candidates = []
        for submap in self._reachable(keyframe, config.reach + config.max_shift):
            drift = float(distances[self.submaps[submap].anchor])
            shift = min(0.3 + config.drift * drift, config.max_shift)
            if self._distance(keyframe, submap) <= config.reach + shift:
                turn = min(0.03 + config.turn_drift * drift, config.max_turn)
                candidates.append(Candidate(keyframe, submap, shift, turn))
        candidates.sort(key=lambda c: self._distance(keyframe, c.submap))
        return candidates[:2]

    def _reachable(self, keyframe: int, reach: float) -> list[int]:
        """Return the submaps of earlier visits whose way passes within `reach` of a keyframe."""
        earlier = self.travelled[keyframe] - self.config.min_gap
        return [
            number
            for number, submap in enumerate(self.submaps)
            if self.travelled[submap.last] < earlier and self._distance(keyframe, number) <= reach
        ]

    def _distance(self, keyframe: int, submap: int) -> float:
        way = self.poses[self.submaps[submap].first : self.submaps[submap].last + 1, :2]
        return float(np.hypot(*(way - self.poses[keyframe, :2]).T).min())

    def _graph_distances(self, keyframe: int) -> FloatArray:
        """Return the length of the shortest way from a keyframe to all others, over closures too [m]."""
        count = len(self.poses)
        steps = np.diff(self.travelled)
        sources = np.concatenate((np.arange(count - 1), [e.source for e in self.closures])).astype(np.int64)
        targets = np.concatenate((np.arange(1, count), [e.target for e in self.closures])).astype(np.int64)
        lengths = np.concatenate((steps + 1e-9, np.full(len(self.closures), 0.5)))
        graph = coo_array((lengths, (sources, targets)), shape=(count, count)).tocsr()
        return np.asarray(dijkstra(graph, directed=False, indices=[keyframe]))[0]

    def _closure(self, candidate: Candidate) -> MotionEdge | None:
        """Search a keyframe's bundle in a submap; return the motion that places it, if it can be trusted."""
        config = self.config
        submap = self.submaps[candidate.submap]
        cloud = self._bundle(candidate.keyframe)
        if len(cloud) < config.search_points // 2:
            return None
        guess = SE2.from_array(self.poses[submap.anchor]).inverse() @ SE2.from_array(self.poses[candidate.keyframe])
        if candidate.shift > 0.2:
            few = cloud[:: max(len(cloud) // config.search_points, 1)]
            guess = submap.coarse.search(few, guess, _disc(candidate.shift, 0.2), _fan(candidate.turn, 0.03), 3.0)
        some = cloud[:: max(len(cloud) // config.match_points, 1)]
        weights = np.full(len(some), 40.0 / len(some))
        prior = np.diag([4.0, 4.0, 25.0])
        result = submap.fine.register(some, weights, guess, prior, np.array([20.0, 8.0, 3.0]), 10)
        if result.matched < config.min_matched:
            return None
        eigenvalues = np.linalg.eigvalsh(result.hessian[:2, :2])
        if eigenvalues[0] < config.min_determined * eigenvalues[1]:
            return None
        return MotionEdge(
            submap.anchor, candidate.keyframe, result.pose, self._information(result.hessian, result.pose)
        )

    def _information(self, hessian: FloatArray, pose: SE2) -> FloatArray:
        """Return a closure's information in the keyframe's frame: its curvature, and what submaps bend at best."""
        config = self.config
        floor = np.diag([config.position_deviation**2, config.position_deviation**2, config.heading_deviation**2])
        information = np.linalg.inv(np.linalg.inv(hessian + np.eye(3) * 1e-3) + floor)
        rotation = np.eye(3)
        cosine, sine = np.cos(pose.theta), np.sin(pose.theta)
        rotation[:2, :2] = [[cosine, -sine], [sine, cosine]]
        return np.asarray(rotation.T @ information @ rotation)

    def _bundle(self, keyframe: int) -> FloatArray:
        """Return the hits (M, 2) of a keyframe and its neighbours in the keyframe's frame."""
        near = np.flatnonzero(np.abs(self.travelled - self.travelled[keyframe]) <= self.config.bundle)
        T_keyframe_map = SE2.from_array(self.tracked[keyframe]).inverse()
        parts = [
            (T_keyframe_map @ SE2.from_array(self.tracked[index])).apply(self.points[index])
            for index in near[:: max(len(near) // 8, 1)]
        ]
        return np.vstack([self.points[keyframe], *parts])


def _disc(radius: float, step: float) -> FloatArray:
    """Return shifts (M, 2) within a radius, on a grid [m]."""
    axis = np.arange(-np.floor(radius / step), np.floor(radius / step) + 1.0) * step
    shifts = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    inside: FloatArray = shifts[np.hypot(*shifts.T) <= radius + 1e-9]
    return inside


def _fan(half_angle: float, step: float) -> FloatArray:
    """Return turns (K,) within a half angle [rad]."""
    return np.arange(-np.floor(half_angle / step), np.floor(half_angle / step) + 1.0) * step
