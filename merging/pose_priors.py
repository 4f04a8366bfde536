"""Maps whose poses somebody knows: laid there, and made exact where walls agree.

Who knows roughly where a robot started needs no search, and may know better than the maps can tell: a corridor alike
everywhere, a plan drawn otherwise than a laser sees. What the maps say for and against the place is told all the same.
"""

import itertools
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from merging.alignment import Alignment, Pair, format_evidence
from merging.config import MergeConfig
from merging.config.registration import KnownPoseConfig
from merging.fusion.warping import corners_of
from merging.pairwise import PreparedMaps
from merging.registration.hypotheses import Candidate, best_of, find_candidates
from merging.rigid_alignment import PreparedMap
from merging.scoring.confidence import confidences
from merging.scoring.decoys import find_decoys
from merging.verification.covariance import covariance_of
from merging.verification.evidence import Evidence, examine
from merging.walls.wall_map import WallMap, without_walls
from tbmslam.errors import TbmSlamError
from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.map.map_check import MAX_CELLS
from tbmslam.map.tbm_map import TbmMap

logger = logging.getLogger(__name__)

_SHIFTS, _TURNS = 5, 9
"""So many starts along each axis and of the rotation, up to as far as the pose may be wrong."""
_NEVER = 1e-300
"""No place is less likely than this."""


class KnownPoseError(TbmSlamError):
    """A told pose that no merged map can have: one line with the map, the fact and the remedy."""


@dataclass(frozen=True)
class PriorPoses:
    """Where maps lie that somebody knows the poses of.

    Parameters
    ----------
    poses
        T_first_map of the first map and of those told, made exact; empty where nothing was told.
    alignments
        Each told map in that one of the maps before it which it shares most walls with; all are accepted.
    """

    poses: Mapping[str, SE2]
    alignments: dict[Pair, Alignment]


def place_by_priors(maps: Mapping[str, TbmMap], config: MergeConfig) -> PriorPoses:
    """Lay maps where `MergeConfig.known_poses` says, each onto one of those before it.

    Raises
    ------
    ValueError
        If a pose is told of a map that is none of these, or of the first.
    KnownPoseError
        If a map would lie so far from the others that the merged map had too many cells.
    """
    first = next(iter(maps))
    for name in config.known_poses:
        if name == first or name not in maps:
            raise ValueError(f"known_poses must be of maps after the first, {first!r}, got {name!r}")
    if not config.known_poses:
        return PriorPoses({}, {})
    views = PreparedMaps(
        {name: one.grid for name, one in maps.items()}, config.model_copy(update={"method": "correlation"})
    )
    resolution = config.merged_resolution or maps[first].grid.geometry.resolution
    poses, alignments = {first: SE2.identity()}, dict[Pair, Alignment]()
    for name in (name for name in maps if name in config.known_poses):
        guess = SE2(*config.known_poses[name])
        target = max(poses, key=lambda one: _shared_wall_m(one, name, poses[one].inverse() @ guess, views, config))
        found = align_near(*views.of_pair((target, name)), poses[target].inverse() @ guess, config)
        logger.info("%s in %s: %s", name, target, found.reason)
        if found.evidence is not None and found.evidence.conflicting_wall_m > found.evidence.agreed_wall_m:
            logger.warning("%s: more of its walls contradict the given pose than confirm it: is it right?", name)
        alignments[target, name] = found
        poses[name] = poses[target] @ (found.T_target_source or SE2.identity())
        _check_extent(name, [corners_of(maps[one].grid.geometry, pose) for one, pose in poses.items()], resolution)
    return PriorPoses(poses, alignments)


def _check_extent(name: str, corners: Sequence[FloatArray], resolution: float) -> None:
    """Refuse a map with which the merged one would be too large."""
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
    """Return where a map lies near a told pose; the confidence is what the maps alone would give that place.

    Parameters
    ----------
    target, source
        The maps; None for one of which nothing is known.
    T_target_source
        The told pose of the source in the target's frame.
    config
        How far off it may be.
    """
    if target is None or source is None:
        empty = "target" if target is None else "source"
        return Alignment("told", True, f"placed at the given pose: the {empty} map is empty", T_target_source)
    place, evidence, confidence = _likeliest(target.structure, source.structure, T_target_source, config)
    enough = evidence.agreed_wall_m >= config.pose_priors.min_wall_m
    bare = without_walls(target.structure, source.structure)
    how = f"laid as told: {bare}" if bare else _how_laid(place, T_target_source, source.structure, enough)
    answer = Alignment("told", accepted=True, reason=f"{how}; {format_evidence(evidence)}")
    limits = config.verification.limits()
    told = {"place_m": 0.5 * config.pose_priors.reach_m, "turn_rad": 0.5 * config.pose_priors.reach_rad}
    exactness = config.covariance.model_copy(update=told)  # where no wall says more, as whoever told
    covariance = covariance_of(target.structure, source.structure, place, limits, exactness)
    answer = answer.matched_by_walls(evidence, target.structure.geometry.resolution)
    return answer.at(place, evidence, confidence, covariance)


def _likeliest(target: WallMap, source: WallMap, told: SE2, config: MergeConfig) -> tuple[SE2, Evidence, float]:
    """Return the place near the told one that walls and the one who told speak for, and its share of all places."""
    near, elsewhere = _places_near(target, source, told, config), find_candidates(target, source, config)
    elsewhere = [one for one in elsewhere if not _is_near(one[0], told, source, config.pose_priors)]
    decoys = find_decoys(target, source, config)
    likely = confidences([evidence for _, evidence in near], decoys)
    # Walls along a corridor say nothing of where along it: there whoever told does.
    surprise = [0.5 * (2.0 * _apart(motion, told, source)[0] / config.pose_priors.reach_m) ** 2 for motion, _ in near]
    best = max(range(len(near)), key=lambda index: math.log(max(likely[index], _NEVER)) - surprise[index])
    place, evidence = near[best]
    return place, evidence, confidences([evidence, *(other for _, other in elsewhere)], decoys)[0]


def _places_near(target: WallMap, source: WallMap, told: SE2, config: MergeConfig) -> list[Candidate]:
    """Return places near the told one that enough walls speak for; the told one itself where there is none.

    Walls draw the told pose across their ways only, so that the place this leads to is one, whichever has more to say.
    """
    found = [
        (motion, evidence)
        for starts in ([told], _starts(told, source, config.pose_priors))
        for motion, evidence in best_of(starts, target, source, config)
        if _is_near(motion, told, source, config.pose_priors)
        and evidence.agreed_wall_m >= config.pose_priors.min_wall_m
    ]
    return found or [(told, examine(target, source, told, config.verification))]


def _starts(told: SE2, source: WallMap, reach: KnownPoseConfig) -> list[SE2]:
    """Return the told pose, turned about the centroid of the source's walls and moved, as far as it may be wrong."""
    shifts = np.linspace(-reach.reach_m, reach.reach_m, _SHIFTS)
    turns = np.linspace(-reach.reach_rad, reach.reach_rad, _TURNS)
    T_map_centroid = SE2.from_array(np.append(source.centroid, 0.0))
    offsets = (SE2(x, y, turn) for x, y, turn in itertools.product(shifts, shifts, turns))
    return [told @ T_map_centroid @ offset @ T_map_centroid.inverse() for offset in offsets]


def _is_near(motion: SE2, told: SE2, source: WallMap, reach: KnownPoseConfig) -> bool:
    moved_m, turned = _apart(motion, told, source)
    return moved_m <= math.sqrt(2.0) * reach.reach_m and turned <= reach.reach_rad


def _apart(motion: SE2, told: SE2, source: WallMap) -> tuple[float, float]:
    """Return how far two motions put the centroid of the source's walls apart [m], and by which angle they differ."""
    return math.dist(motion.apply(source.centroid), told.apply(source.centroid)), abs(
        wrap_angle(motion.theta - told.theta)
    )


def _how_laid(place: SE2, told: SE2, source: WallMap, enough: bool) -> str:
    if not enough:
        return "placed exactly at the given pose, as hardly any wall can refine it"
    moved_m, turned = _apart(place, told, source)
    return f"placed at the given pose, refined by {moved_m:.2f} m and {math.degrees(turned):.1f} degrees"


def _shared_wall_m(target: str, source: str, motion: SE2, views: PreparedMaps, config: MergeConfig) -> float:
    """Return how much wall of two maps lies where the other knows something [m]."""
    one, other = views.of_pair((target, source))
    if one is None or other is None:
        return 0.0
    return examine(one.structure, other.structure, motion, config.verification).compared_wall_m
