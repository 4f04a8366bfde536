"""Places seen again: found by search, verified, and the whole drive bent so that they coincide.

Stretches of the drive are joined into submaps. Wherever the drive may have come back, which a model of its drift says,
a bundle of neighbouring keyframes is searched for in the old submap, laid onto its surfaces and verified: enough of it
must lie on surfaces, little in space known to be free, and no other place may fit as well. A direction that the fit
leaves open, as along a corridor, stays open. Accepted closures enter a robust pose graph.
"""

import logging
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from tbmslam.drive_correction import spread_corrections
from tbmslam.laser_scan import Hits, LaserScan
from tbmslam.pose_graph import MotionEdge, edge_error, optimise, relative_pose
from tbmslam.se2 import SE2, FloatArray
from tbmslam.skeleton import Skeleton
from tbmslam.submap import Submap, SubmapConfig, split_into_submaps
from tbmslam.surfel_map import SurfelConfig

_log = logging.getLogger(__name__)


class LoopClosingConfig(BaseModel):
    """When a place is taken for one seen before."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    enabled: bool = Field(True, description="close loops at all")
    submap: SubmapConfig = SubmapConfig()
    min_gap: float = Field(12.0, gt=0, description="travelled length between two visits to a place [m]")
    reach: float = Field(4.0, gt=0, description="how near a keyframe must be to a submap's way [m]")
    bundle: float = Field(1.5, ge=0, description="keyframes within this length before and after join a search [m]")
    step: float = Field(1.0, gt=0, description="travelled length between keyframes that are searched for [m]")
    submaps_per_step: int = Field(2, ge=1, description="nearest old submaps that are searched each time")
    drift: float = Field(0.03, gt=0, description="position drift by travelled length, for the search window [m/m]")
    turn_drift: float = Field(0.006, gt=0, description="heading drift by travelled length [rad/m]")
    max_shift: float = Field(4.0, gt=0, description="largest search window [m]")
    max_turn: float = Field(0.5, gt=0, description="largest search window [rad]")
    surprise: float = Field(0.15, gt=0, description="a closure that moves its keyframe by more is used at once [m]")
    search_points: int = Field(150, ge=10, description="hits of a bundle used in a search")
    match_points: int = Field(500, ge=10, description="hits of a bundle laid onto the surfaces")
    min_matched: float = Field(0.58, ge=0, le=1, description="share of a bundle that must lie on surfaces")
    max_violated: float = Field(0.2, ge=0, description="hits in known free space for one on surfaces, at the most")
    max_slide: float = Field(0.3, gt=0, description="how far a fit may end from where it began [m]")
    max_ambiguity: float = Field(0.9, ge=0, le=1, description="score of another place over the best one's")
    min_determined: float = Field(
        0.02, ge=0, description="curvature of a direction over the other's below which it is open"
    )
    position_deviation: float = Field(0.02, gt=0, description="accuracy of a closure at best [m]")
    heading_deviation: float = Field(0.004, gt=0, description="accuracy of a closure at best [rad]")
    max_contradiction: float = Field(4.0, gt=0, description="deviations from the solution that end a closure")
    robust_width: float = Field(2.0, gt=0, description="deviations at which a closure begins to lose its say")


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
        drive = _Drive(self._config, self._surfels, poses, scans, list(chain))
        drive.search_forward()
        for _ in range(2):
            drive.tighten()
            drive.drop_contradictions()
        _log.info("%d closures between %d keyframes", len(drive.closures), len(poses))
        return drive.corrected(), list(drive.closures.values())


class _Drive:
    """One drive being corrected; its closures are kept by keyframe and submap."""

    def __init__(
        self,
        config: LoopClosingConfig,
        surfels: SurfelConfig,
        poses: FloatArray,
        scans: Sequence[LaserScan],
        chain: list[MotionEdge],
    ) -> None:
        self.config = config
        self.poses = poses.copy()
        self.closures: dict[tuple[int, int], MotionEdge] = {}
        self._tracked = poses
        self._scans = scans
        self._travelled = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
        stretches = split_into_submaps(poses, config.submap.length)
        self._submaps = [Submap(first, last, poses, scans, config.submap, surfels) for first, last in stretches]
        self._ends = self._travelled[[last for _, last in stretches]]
        self._stretches = np.array([(first, last + 1) for first, last in stretches]).reshape(-1)
        self._bundles: dict[int, Hits] = {}
        anchors = [submap.anchor for submap in self._submaps]
        nodes = np.unique(np.concatenate(([0], self._stops(config.step), self._stops(0.5 * config.step), anchors)))
        self._skeleton = Skeleton(chain, nodes, poses)

    def search_forward(self) -> None:
        """Follow the drive in time and close what it comes back to, correcting at once what follows."""
        for keyframe in self._stops(self.config.step):
            surprised = False
            for submap, shift, turn in self._candidates(keyframe):
                edge = self._closure(keyframe, submap, shift, turn)
                if edge is not None:
                    self.closures[keyframe, submap] = edge
                    surprised = surprised or self._is_surprising(edge)
            if surprised:
                self._optimise()
        self._optimise()

    def tighten(self) -> None:
        """Lay every keyframe near an old submap onto it once more, now that the poses are nearly right."""
        for keyframe in self._stops(0.5 * self.config.step):
            distances = np.where(self._is_old(keyframe), self._distances_to_submaps(keyframe), np.inf)
            nearest = np.argsort(distances, kind="stable")[: self.config.submaps_per_step]
            for submap in nearest[distances[nearest] <= 0.5].tolist():
                edge = self._closure(keyframe, submap, 0.0, 0.0)
                if edge is not None:
                    self.closures[keyframe, submap] = edge
        self._optimise()

    def drop_contradictions(self) -> None:
        """Drop the closures that the rest of the drive contradicts, and do without them."""
        limit = self.config.max_contradiction
        agreeing = {key: edge for key, edge in self.closures.items() if edge_error(edge, self.poses) <= limit}
        if len(agreeing) < len(self.closures):
            self.closures = agreeing
            self._optimise()

    def corrected(self) -> FloatArray:
        """Return all poses (N, 3), those between two solved ones following both."""
        nodes = self._skeleton.nodes
        return spread_corrections(self._tracked, nodes, self.poses[nodes]) if self.closures else self._tracked

    def _is_surprising(self, edge: MotionEdge) -> bool:
        """Tell whether a closure moves its keyframe so far that the next search should know."""
        error = edge.T_source_target.inverse() @ relative_pose(self.poses, edge.source, edge.target)
        return math.hypot(error.x, error.y) > self.config.surprise

    def _stops(self, step: float) -> npt.NDArray[np.int64]:
        """Return keyframes that lie at least about `step` metres apart."""
        _, first = np.unique((self._travelled / step).astype(np.int64), return_index=True)
        return np.asarray(first, dtype=np.int64)

    def _optimise(self) -> None:
        if self.closures:
            skeleton = self._skeleton
            closures = skeleton.on_nodes(list(self.closures.values()))
            solved = optimise(self.poses[skeleton.nodes], skeleton.chain, closures, self.config.robust_width)
            self.poses = skeleton.spread(solved)

    def _candidates(self, keyframe: int) -> list[tuple[int, float, float]]:
        """Return the old submaps that a keyframe may see, and how far [m], [rad] both may have drifted apart."""
        config = self.config
        distances = self._distances_to_submaps(keyframe)
        near = np.flatnonzero(self._is_old(keyframe) & (distances <= config.reach + config.max_shift))
        if not len(near):
            return []
        drifts = self._ways(keyframe)[[self._submaps[number].anchor for number in near]]
        shifts = np.minimum(0.3 + config.drift * drifts, config.max_shift)
        turns = np.minimum(0.03 + config.turn_drift * drifts, config.max_turn)
        order = [
            k for k in np.argsort(distances[near], kind="stable") if distances[near[k]] <= config.reach + shifts[k]
        ]
        return [(int(near[k]), float(shifts[k]), float(turns[k])) for k in order[: config.submaps_per_step]]

    def _is_old(self, keyframe: int) -> npt.NDArray[np.bool_]:
        """Return which submaps belong to an earlier visit."""
        return np.asarray(self._ends < self._travelled[keyframe] - self.config.min_gap)

    def _distances_to_submaps(self, keyframe: int) -> FloatArray:
        """Return how far a keyframe is from the way of every submap [m]."""
        distances = np.append(np.hypot(*(self.poses[:, :2] - self.poses[keyframe, :2]).T), np.inf)
        return np.minimum.reduceat(distances, self._stretches)[::2]

    def _ways(self, keyframe: int) -> FloatArray:
        """Return the length of the shortest way from a keyframe to all others, over closures too [m]."""
        count = len(self.poses)
        closures = list(self.closures.values())
        sources = np.concatenate((np.arange(count - 1), [e.source for e in closures])).astype(np.int64)
        targets = np.concatenate((np.arange(1, count), [e.target for e in closures])).astype(np.int64)
        lengths = np.concatenate((np.diff(self._travelled) + 1e-9, np.full(len(closures), 0.5)))
        graph = coo_array((lengths, (sources, targets)), shape=(count, count)).tocsr()
        ways: FloatArray = dijkstra(graph, directed=False, indices=[keyframe])[0]
        return ways

    def _closure(self, keyframe: int, number: int, shift: float, turn: float) -> MotionEdge | None:
        """Search a keyframe's bundle in a submap; return the motion that places it, if it can be trusted."""
        config, submap = self.config, self._submaps[number]
        bundle = self._bundle(keyframe)
        if len(bundle.points) < config.search_points // 2:
            return None
        guess = relative_pose(self.poses, submap.anchor, keyframe)
        rival = None
        if shift > 0.0:
            found = submap.search(bundle.thinned(config.search_points).points, guess, shift, turn)
            if found.at_border:
                return None
            rival = found.rival if found.ambiguity > config.max_ambiguity else None
            guess = found.pose
        fit = submap.fit(bundle.thinned(config.match_points), guess)
        if fit.matched < config.min_matched or fit.violated > config.max_violated * fit.matched:
            return None
        hessian = self._determined(fit.hessian, rival)
        if hessian is None or math.hypot(fit.pose.x - guess.x, fit.pose.y - guess.y) > config.max_slide:
            return None
        return MotionEdge(submap.anchor, keyframe, fit.pose, self._information(hessian, fit.pose))

    def _determined(self, hessian: FloatArray, rival: FloatArray | None) -> FloatArray | None:
        """Return the curvature without the direction that a fit leaves open; None where a rival lies across.

        Along a corridor many places fit alike, and still they tell how far away its walls are and where it leads.
        """
        strengths, directions = np.linalg.eigh(hessian[:2, :2])
        open_direction = directions[:, 0]
        if rival is not None and abs(rival @ open_direction) < 0.9 * np.hypot(*rival):
            return None
        if rival is None and strengths[0] >= self.config.min_determined * strengths[1]:
            return hessian
        kept = np.eye(3)
        kept[:2, :2] -= np.outer(open_direction, open_direction)
        closed: FloatArray = kept @ hessian @ kept
        return closed

    def _information(self, hessian: FloatArray, pose: SE2) -> FloatArray:
        """Return a closure's information in the keyframe's frame: its curvature, and what submaps bend at best."""
        config = self.config
        floor = np.diag([config.position_deviation**2, config.position_deviation**2, config.heading_deviation**2])
        information = np.linalg.inv(np.linalg.inv(hessian + np.eye(3) * 1e-3) + floor)
        rotation = SE2(0.0, 0.0, pose.theta).matrix()
        return np.asarray(rotation.T @ information @ rotation)

    def _bundle(self, keyframe: int) -> Hits:
        """Return the hits of a keyframe and its neighbours in the keyframe's frame."""
        if keyframe not in self._bundles:
            near = np.flatnonzero(np.abs(self._travelled - self._travelled[keyframe]) <= self.config.bundle)
            chosen = [keyframe, *near[:: max(len(near) // 8, 1)].tolist()]
            limit = self.config.submap.max_range
            self._bundles[keyframe] = Hits.joined(
                [self._scans[k].hits(limit).placed(relative_pose(self._tracked, keyframe, k)) for k in chosen]
            )
        return self._bundles[keyframe]
