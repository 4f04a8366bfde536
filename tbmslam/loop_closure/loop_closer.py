"""Loop closure: revisited places are searched, verified, and corrected by a robust pose graph.

The drive is divided into submaps. The model of the drift states if the drive may have returned to an old submap. Then a
bundle of neighbouring keyframes is searched in the submap, registered to its surfaces, and verified: many hits must lie
on surfaces, and few in free space. A direction that the fit does not determine, as along a corridor, stays
undetermined. If the drift may be large, a find is accepted only if several finds along the drive agree, the drift
allows them, and no other place fits them as well.
"""

import logging
import math
from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from tbmslam.frozen_config import FrozenConfig
from tbmslam.geometry.se2 import SE2, FloatArray, compose
from tbmslam.loop_closure.candidates import ChainDrift, ClosingTargets
from tbmslam.loop_closure.closure_graph import ROUGHLY, ClosureGraph, ClosureGraphConfig
from tbmslam.loop_closure.drift_test import DriftTest
from tbmslam.loop_closure.far_search import FarSearch
from tbmslam.loop_closure.loose_steps import LooseSteps
from tbmslam.loop_closure.sequence_consistency import ClosureVotes, ClosureVotesConfig, PlacedBundle
from tbmslam.loop_closure.submap import SubmapConfig, open_direction, without_open_direction
from tbmslam.map.scan_hits import DriveHits, ScanHits
from tbmslam.optimisation.pose_graph import MotionChain, MotionEdge, relative_pose
from tbmslam.parallel.executor import Progress
from tbmslam.sensing.laser_scan import Hits
from tbmslam.tracking.surfel_map import SurfelConfig

logger = logging.getLogger(__name__)
_FAR_STEP = 2.0
"""Travelled length between keyframes that are searched for far away [m]."""
_FAR_BUNDLE = 4.0
"""Path before and after a keyframe whose hits form a bundle for far searches, as single scans are ambiguous [m]."""
_FAR_VOTES = ClosureVotesConfig(
    min_matched=0.1,
    violation_cost=2.0,
    min_vote=0.05,
    stops=4,
    min_sum=0.6,
    margin=2.0,
    memory=24.0,
    together=0.5,
    apart=1.0,
)
"""A long bundle extends far beyond a target, so a small share of it may match; the votes must have a larger sum and
margin."""


class LoopClosingConfig(FrozenConfig):
    """When a place counts as visited before."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="close loops")
    submap: SubmapConfig = SubmapConfig()
    min_gap: float = Field(12.0, gt=0, description="travelled length between two visits to a place [m]")
    reach: float = Field(4.0, gt=0, description="largest distance of a keyframe from the path of a submap [m]")
    bundle: float = Field(1.5, ge=0, description="path before and after a keyframe whose hits form a bundle [m]")
    step: float = Field(1.0, gt=0, description="travelled length between keyframes that are searched for [m]")
    submaps_per_step: int = Field(2, ge=1, description="largest number of near old submaps that are searched")
    familiar: float = Field(
        0.75, gt=0, le=1, description="share of a submap, found in older submaps, from which on it is no target"
    )
    drift: float = Field(0.03, gt=0, description="position drift by travelled length, for the search window [m/m]")
    turn_drift: float = Field(0.006, gt=0, description="heading drift by travelled length [rad/m]")
    max_shift: float = Field(8.0, gt=0, description="largest search window [m]")
    max_turn: float = Field(0.3, gt=0, description="largest search window without loose steps [rad]")
    surprise: float = Field(0.3, gt=0, description="a closure that moves its keyframe farther is applied at once [m]")
    search_points: int = Field(120, ge=10, description="hits of a bundle used in a search")
    match_points: int = Field(300, ge=10, description="hits of a bundle that are registered to surfaces")
    min_matched: float = Field(0.58, ge=0, le=1, description="share of a bundle that must lie on surfaces")
    max_violated: float = Field(0.2, ge=0, description="most hits in free space for each hit on surfaces")
    max_slide: float = Field(0.3, gt=0, description="largest distance of a fit from its initial pose [m]")
    votes: ClosureVotesConfig = ClosureVotesConfig()
    graph: ClosureGraphConfig = ClosureGraphConfig()
    min_determined: float = Field(
        0.02, ge=0, description="least curvature of a determined direction relative to the other"
    )


class LoopCloser:
    """Finds closures in a drive and returns the drive corrected."""

    def __init__(self, config: LoopClosingConfig, surfels: SurfelConfig) -> None:
        self._config = config
        self._surfels = surfels

    def close(
        self, poses: FloatArray, scans: ScanHits, chain: MotionChain, progress: Progress | None = None
    ) -> tuple[FloatArray, list[MotionEdge]]:
        """Return the corrected poses (N, 3) of the laser at every keyframe, and the closures that corrected them.

        `poses` (N, 3) are those of the laser as tracked, and `chain` the motions between consecutive keyframes.
        """
        drive = _Drive(self._config, self._surfels, poses, scans, chain, progress or Progress())
        drive.search_forward()
        drive.tighten()
        drive.graph.drop_contradictions()
        logger.info("%d closures between %d keyframes", len(drive.graph.closures), len(poses))
        return drive.graph.poses, list(drive.graph.closures.values())


class _Bundle(NamedTuple):
    """The hits of a keyframe and its neighbours, and the points (N, 2) for the search."""

    hits: Hits
    points: FloatArray


class _Election(NamedTuple):
    """Votes of keyframes for places, and the test of the elected place."""

    votes: ClosureVotes
    test: DriftTest
    bundle: tuple[float, int]
    """Path before and after a keyframe [m] whose hits vote, and their least number."""


class _Drive:
    """The searches along one drive."""

    def __init__(
        self,
        config: LoopClosingConfig,
        surfels: SurfelConfig,
        poses: FloatArray,
        scans: ScanHits,
        chain: MotionChain,
        progress: Progress,
    ) -> None:
        self.config = config
        self._progress = progress
        self.graph = ClosureGraph(config.graph, poses, chain)
        self._loose = LooseSteps(poses, chain.covariances)
        # Longer than a submap, so that neither a submap nor a bundle extends over a loose step.
        self._hits = DriveHits(scans, poses, self._loose.ends(), 2.0 * config.submap.length)
        self._targets = ClosingTargets(self._hits, config.submap, surfels, config.min_gap, config.familiar)
        self._bundle: tuple[int, _Bundle | None] = -1, None
        self._chain = chain
        drift = ChainDrift(poses, chain.covariances)
        self._far = FarSearch(self._hits, self._targets, drift, config.max_shift, config.reach)
        self._near_election = self._election(config.votes, config.bundle, config.match_points)
        self._far_election = self._election(_FAR_VOTES, _FAR_BUNDLE, 2 * config.match_points)
        self._far_stop = -1

    def _election(self, config: ClosureVotesConfig, length: float, points: int) -> _Election:
        """Return an election without votes."""
        test = DriftTest(self._chain, self._targets, self._hits, self.config.graph.robust_width, length, points)
        return _Election(ClosureVotes(config, self._hits.travelled), test, (length, points))

    def search_forward(self) -> None:
        """Close loops in the order of the drive; large corrections are applied before the next search."""
        stops = self._hits.stops(self.config.step)
        for keyframe in self._progress.each(stops, "closing loops", len(stops), "places"):
            self._targets.advance(keyframe)
            fits = self._found(keyframe)
            elected = [] if fits else self._found_far(keyframe)
            self._add(keyframe, fits + elected)
            if elected:
                self.graph.pull_together()
            elif any(self.graph.correction_m(fit) > self.config.surprise for fit in fits):
                self.graph.optimise(ROUGHLY)
        self.graph.optimise()

    def _add(self, keyframe: int, found: list[PlacedBundle]) -> None:
        """Add closures that were found at a keyframe."""
        self.graph.add(found)
        self._targets.note(keyframe, [fit.target for fit in found if fit.keyframe == keyframe])
        for fit in found:
            self._loose.bridge(fit.keyframe, self._targets.stretch(fit.target)[1])

    def tighten(self) -> None:
        """Register the keyframes near old submaps once more from the corrected poses.

        Bundle adjustment corrects the remaining errors.
        """
        stops = self._hits.stops(self.config.step)
        for keyframe in self._progress.each(stops, "tightening loops", len(stops), "places"):
            near = self._targets.near(keyframe, self.graph.poses, 0.5)
            for target in near.targets[: self.config.submaps_per_step].tolist():
                if self.graph.has_met(keyframe, target):
                    break
                fit = self._fit(keyframe, target, 0.0, 0.0)
                if fit is not None:
                    self.graph.add([fit])
                    break
        self.graph.optimise()

    def _candidates(self, keyframe: int) -> list[tuple[int, float, float]]:
        """Return the targets that a keyframe may see, with the windows of the search [m], [rad] by the drift."""
        config = self.config
        near, distances = self._targets.near(keyframe, self.graph.poses, config.reach + config.max_shift)
        if not len(near):
            return []
        drifts, anchors = self._targets.path_lengths(keyframe)[near], self._targets.anchors(keyframe)
        loose, found = self._loose.windows(keyframe, anchors[1][near]), []
        shifts = np.minimum(0.3 + config.drift * drifts + loose[:, 0], config.max_shift).tolist()
        turns = (np.minimum(0.03 + config.turn_drift * drifts, config.max_turn) + loose[:, 1]).tolist()
        for target, distance, shift, turn in zip(near.tolist(), distances.tolist(), shifts, turns, strict=True):
            if distance <= config.reach + shift:
                found.append((target, shift, turn))
                if len(found) == config.submaps_per_step:
                    break
        return found

    def _found(self, keyframe: int) -> list[PlacedBundle]:
        """Return the pose of a keyframe's bundle in the nearest submap that it fits, and poses that were elected.

        A wide search votes for its poses, which are elected if several keyframes along the drive agree.
        """
        fit, votes = None, list[PlacedBundle]()
        for target, shift, turn in self._candidates(keyframe):
            if shift > self.config.votes.beyond or turn > self.config.max_turn:
                votes += self._votes_for(keyframe, target, shift, turn)
            elif fit is None:
                fit = self._fit(keyframe, target, shift, turn)
        elected = self._elected(self._near_election, votes)
        return elected if fit is None else [fit, *elected]

    def _elected(self, election: _Election, votes: list[PlacedBundle]) -> list[PlacedBundle]:
        """Add votes; return those that agree, if they outweigh all others and the drive's motions allow them."""
        if not votes:
            return []
        election.votes.add(votes)
        elected = election.votes.elected(self.graph.poses)
        if not elected:
            return []
        covariance, closures = self.graph.covariances(elected[-1:])[0], list(self.graph.closures.values())
        if not election.test.allows(elected, covariance, self.graph.poses, closures):
            return []
        if any(not election.votes.outweighs(elected, rival) for rival in self._rivals(election, elected)):
            return []
        election.votes.forget()
        return elected

    def _rivals(self, election: _Election, elected: list[PlacedBundle]) -> Iterator[list[PlacedBundle]]:
        """Yield the votes of the elected keyframes for each other place that any keyframe proposes.

        A search proposes few of the many similar places, and each keyframe may propose others.
        """
        stops = sorted({vote.keyframe for vote in elected})
        bundles = {keyframe: self._hits.bundle(keyframe, *election.bundle) for keyframe in stops}
        for correction in election.votes.rivals(elected, self.graph.poses):
            poses = self.graph.poses.copy()
            poses[stops] = compose(correction[None], poses[stops])
            votes = []
            for keyframe in stops:
                near = self._targets.near(keyframe, poses, self.config.reach).targets[: self.config.submaps_per_step]
                for target in near.tolist():
                    place = relative_pose(poses, self._targets.submap(target).anchor, keyframe)
                    vote = self._vote(election.votes, keyframe, target, bundles[keyframe], place)
                    if vote is not None:
                        votes.append(vote)
            yield votes

    def _votes_for(self, keyframe: int, target: int, shift: float, turn: float) -> list[PlacedBundle]:
        """Return the possible poses of a keyframe's bundle in a target."""
        config, submap, bundle = self.config, self._targets.submap(target), self._bundle_of(keyframe)
        if bundle is None:
            return []
        guess = relative_pose(self.graph.poses, submap.anchor, keyframe)
        places = submap.places(bundle.points, guess, shift, turn, config.votes.places)
        votes = (self._vote(self._near_election.votes, keyframe, target, bundle.hits, place) for place in places)
        return [vote for vote in votes if vote is not None]

    def _vote(self, votes: ClosureVotes, keyframe: int, target: int, bundle: Hits, place: SE2) -> PlacedBundle | None:
        """Register a bundle to a target near a pose; return the result with its weight, or None if it is weak."""
        submap = self._targets.submap(target)
        fit = submap.fit(bundle, place)
        weight = votes.weight(fit.matched, fit.violated)
        is_near = math.hypot(fit.pose.x - place.x, fit.pose.y - place.y) <= self.config.max_slide
        if weight <= 0.0 or not is_near or open_direction(fit.hessian, self.config.min_determined) is not None:
            return None
        return PlacedBundle(keyframe, target, submap.anchor, fit.pose, fit.hessian, weight, fit.violated)

    def _found_far(self, keyframe: int) -> list[PlacedBundle]:
        """Return the poses of a keyframe's bundle beyond its window, once several along the drive agree."""
        stop = int(self._hits.travelled[keyframe] / _FAR_STEP)
        if stop == self._far_stop:
            return []
        self._far_stop = stop
        possible = self._far.possible(keyframe, self.graph.poses)
        if possible is None:
            return []
        bundle = self._hits.bundle(keyframe, *self._far_election.bundle)
        if len(bundle.points) < self.config.search_points // 2:
            return []
        points, votes = bundle.thinned(self.config.search_points).points, []
        few = self.config.search_points // 2
        for target, rough in self._far.places(keyframe, self.graph.poses, bundle, few, possible):
            place = self._targets.submap(target).search(points, rough, 0.6, 0.06).pose
            vote = self._vote(self._far_election.votes, keyframe, target, bundle, place)
            if vote is not None:
                votes.append(vote)
        return self._elected(self._far_election, votes)

    def _fit(self, keyframe: int, target: int, shift: float, turn: float) -> PlacedBundle | None:
        """Search a keyframe's bundle in a target; return its pose if it is verified."""
        config, submap, bundle = self.config, self._targets.submap(target), self._bundle_of(keyframe)
        if bundle is None:
            return None
        guess = relative_pose(self.graph.poses, submap.anchor, keyframe)
        if shift > 0.0:
            found = submap.search(bundle.points, guess, shift, turn)
            # Walls are drawn wider than a fit may miss them, so a fit matches hardly more than the search has found.
            if found.at_border or found.score < config.min_matched:
                return None
            guess = found.pose
        fit = submap.fit(bundle.hits, guess)
        if fit.matched < config.min_matched or fit.violated > config.max_violated * fit.matched:
            return None
        if math.hypot(fit.pose.x - guess.x, fit.pose.y - guess.y) > config.max_slide:
            return None
        return PlacedBundle(
            keyframe, target, submap.anchor, fit.pose, without_open_direction(fit.hessian, config.min_determined)
        )

    def _bundle_of(self, keyframe: int) -> _Bundle | None:
        """Return a keyframe's bundle, kept for several targets; None if it has too few hits."""
        if self._bundle[0] != keyframe:
            config, bundle = self.config, None
            hits = self._hits.bundle(keyframe, config.bundle, config.match_points)
            if len(hits.points) >= config.search_points // 2:
                bundle = _Bundle(hits, hits.thinned(config.search_points).points)
            self._bundle = keyframe, bundle
        return self._bundle[1]
