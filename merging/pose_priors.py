"""Maps with known poses, which are refined by their walls.

A known pose needs no search. It may also be better than any alignment: in a corridor without features, or on a plan
that differs from the maps of a laser. The evidence of the maps is reported too.
"""

import itertools
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment, Pair, covariance_of, format_evidence
from merging.config import MergeConfig
from merging.config.registration import KnownPoseConfig
from merging.pairwise import PreparedMaps
from merging.registration.correlation import Candidate, best_of, find_candidates
from merging.rigid_alignment import PreparedMap
from merging.scoring import confidences, find_decoys
from merging.verification import Evidence, examine
from merging.walls import WallMap, without_walls
from tbmslam.belief.grid_resampling import corners_of
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.map.map_check import MAX_CELLS
from tbmslam.map.tbm_map import TbmMap

logger = logging.getLogger(__name__)

_SHIFTS, _TURNS = 5, 9
"""Numbers of initial positions along each axis and of initial rotations, within the largest error of the pose."""
_LEAST_PROBABILITY = 1e-300  # least probability of a pose


class KnownPoseError(TbmSlamError):
    """A known pose is impossible. The message states the map, the problem and the remedy."""


@dataclass(frozen=True)
class PriorPoses:
    """The maps with known poses."""

    poses: Mapping[str, SE2]
    """T_first_map of the first map and of the maps with known poses, refined; empty without known poses."""
    alignments: dict[Pair, Alignment]
    """Alignment of each of these maps with the earlier map that shares most walls; all are accepted."""


def place_by_priors(maps: Mapping[str, TbmMap], config: MergeConfig) -> PriorPoses:
    """Place the maps of `MergeConfig.known_poses`, each relative to one of the maps before it.

    Raises a `ValueError` if a pose is given for an unknown map, or for the first one, and a `KnownPoseError` if a map
    is so far from the others that the merged map would have too many cells.
    """
    first = next(iter(maps))
    for name in config.known_poses:
        if name == first or name not in maps:
            raise ValueError(f"known_poses must be of maps after the first, {first!r}, got {name!r}")
    if not config.known_poses:
        return PriorPoses({}, {})
    views = PreparedMaps(
        {name: tbm_map.grid for name, tbm_map in maps.items()}, config.model_copy(update={"method": "correlation"})
    )
    resolution = config.merged_resolution or maps[first].grid.geometry.resolution
    poses, alignments = {first: SE2.identity()}, dict[Pair, Alignment]()
    for name in (name for name in maps if name in config.known_poses):
        guess = SE2(*config.known_poses[name])
        target = max(
            poses, key=lambda other: _shared_wall_m(other, name, poses[other].inverse() @ guess, views, config)
        )
        found = align_near(*views.of_pair((target, name)), poses[target].inverse() @ guess, config)
        logger.info("%s in %s: %s", name, target, found.reason)
        if found.evidence is not None and found.evidence.conflicting_wall_m > found.evidence.agreed_wall_m:
            logger.warning("%s: more of its walls contradict the given pose than confirm it: is it right?", name)
        alignments[target, name] = found
        poses[name] = poses[target] @ (found.T_target_source or SE2.identity())
        _check_extent(
            name, [corners_of(maps[placed].grid.geometry, pose) for placed, pose in poses.items()], resolution
        )
    return PriorPoses(poses, alignments)


def _check_extent(name: str, corners: Sequence[FloatArray], resolution: float) -> None:
    """Refuse a map if the merged map would be too large."""
    width, height = np.ptp(np.concatenate(corners), axis=0)
    cols, rows = math.ceil(width / resolution), math.ceil(height / resolution)
    if rows * cols > MAX_CELLS:
        raise KnownPoseError(
            f"{name}: at the given pose the merged map would be {width:.0f} x {height:.0f} m, {rows * cols:.2g} "
            f"cells, more than the {MAX_CELLS:.0e} that are possible: correct the pose, or pass a coarser --resolution"
        )


def align_near(
    target: PreparedMap | None, source: PreparedMap | None, T_target_source: SE2, config: MergeConfig
) -> Alignment:
    """Align two maps, None for an empty one, near a known pose; the confidence is that of the maps alone."""
    if target is None or source is None:
        empty = "target" if target is None else "source"
        return Alignment("prior", True, f"placed at the given pose: the {empty} map is empty", T_target_source)
    pose, evidence, confidence = _likeliest(target.structure, source.structure, T_target_source, config)
    enough = evidence.agreed_wall_m >= config.pose_priors.min_wall_m
    bare = without_walls(target.structure, source.structure)
    text = (
        f"placed at the given pose: {bare}"
        if bare
        else _refinement_text(pose, T_target_source, source.structure, enough)
    )
    answer = Alignment("prior", accepted=True, reason=f"{text}; {format_evidence(evidence)}")
    limits = config.verification.limits()
    prior = {"place_m": 0.5 * config.pose_priors.reach_m, "turn_rad": 0.5 * config.pose_priors.reach_rad}
    settings = config.covariance.model_copy(update=prior)  # without walls the error of the known pose remains
    covariance = covariance_of(target.structure, source.structure, pose, limits, settings)
    answer = answer.matched_by_walls(evidence, target.structure.geometry.resolution)
    return answer.at(pose, evidence, confidence, covariance)


def _likeliest(target: WallMap, source: WallMap, prior: SE2, config: MergeConfig) -> tuple[SE2, Evidence, float]:
    """Return the most likely pose near the known one, by walls and prior, its evidence and its probability."""
    near, elsewhere = _poses_near(target, source, prior, config), find_candidates(target, source, config)
    elsewhere = [candidate for candidate in elsewhere if not _is_near(candidate[0], prior, source, config.pose_priors)]
    decoys = find_decoys(target, source, config)
    likely = confidences([evidence for _, evidence in near], decoys)
    # The walls of a corridor do not determine the position along it: the prior does.
    penalty = [0.5 * (2.0 * _apart(motion, prior, source)[0] / config.pose_priors.reach_m) ** 2 for motion, _ in near]
    best = max(range(len(near)), key=lambda index: math.log(max(likely[index], _LEAST_PROBABILITY)) - penalty[index])
    pose, evidence = near[best]
    return pose, evidence, confidences([evidence, *(other for _, other in elsewhere)], decoys)[0]


def _poses_near(target: WallMap, source: WallMap, prior: SE2, config: MergeConfig) -> list[Candidate]:
    """Return poses near the known one with enough agreeing walls; the known one if there is none.

    Walls correct the known pose only across them, so the refined pose is a candidate in addition to the poses of the
    search.
    """
    found = [
        (motion, evidence)
        for starts in ([prior], _starts(prior, source, config.pose_priors))
        for motion, evidence in best_of(starts, target, source, config)
        if _is_near(motion, prior, source, config.pose_priors)
        and evidence.agreed_wall_m >= config.pose_priors.min_wall_m
    ]
    return found or [(prior, examine(target, source, prior, config.verification))]


def _starts(prior: SE2, source: WallMap, reach: KnownPoseConfig) -> list[SE2]:
    """Return poses around the known one, rotated about the centroid of the source's walls, up to its largest error."""
    shifts = np.linspace(-reach.reach_m, reach.reach_m, _SHIFTS)
    turns = np.linspace(-reach.reach_rad, reach.reach_rad, _TURNS)
    T_map_centroid = SE2.from_array(np.append(source.centroid, 0.0))
    offsets = (SE2(x, y, turn) for x, y, turn in itertools.product(shifts, shifts, turns))
    return [prior @ T_map_centroid @ offset @ T_map_centroid.inverse() for offset in offsets]


def _is_near(motion: SE2, prior: SE2, source: WallMap, reach: KnownPoseConfig) -> bool:
    moved_m, turned = _apart(motion, prior, source)
    return moved_m <= math.sqrt(2.0) * reach.reach_m and turned <= reach.reach_rad


def _apart(motion: SE2, prior: SE2, source: WallMap) -> tuple[float, float]:
    """Return the distance of the source's centroid under two motions [m], and the angle between them [rad]."""
    return math.dist(motion.apply(source.centroid), prior.apply(source.centroid)), abs(
        wrap_angle(motion.theta - prior.theta)
    )


def _refinement_text(pose: SE2, prior: SE2, source: WallMap, enough: bool) -> str:
    if not enough:
        return "placed exactly at the given pose, because hardly any wall can refine it"
    moved_m, turned = _apart(pose, prior, source)
    return f"placed at the given pose, refined by {moved_m:.2f} m and {math.degrees(turned):.1f} degrees"


def _shared_wall_m(target: str, source: str, motion: SE2, views: PreparedMaps, config: MergeConfig) -> float:
    """Return the length of wall in the overlap of two maps [m]."""
    here, there = views.of_pair((target, source))
    if here is None or there is None:
        return 0.0
    return examine(here.structure, there.structure, motion, config.verification).compared_wall_m
