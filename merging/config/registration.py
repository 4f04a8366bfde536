"""Every number of the registration of two maps: rigid, near a known pose, by short ranges, and non-rigid."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from tbmslam.frozen_config import Count, FrozenConfig, Metres, Share
from tbmslam.map.map_check import MAX_DISTANCE, MAX_TURN

Descriptor = Literal["concatenated", "and", "or", "xor", "pignistic"]
"""How the descriptors of a keypoint in two images of a map become one."""


class FeatureConfig(FrozenConfig):
    """Keypoints and how they are matched: the paper's numbers, and OpenCV's where the paper is silent.

    Parameters
    ----------
    keypoints
        Keypoints wanted in each map.
    descriptor
        What is matched: the descriptors of the occupied, free and unknown image `concatenated`, joined bit by bit
        (`and`, `or`, `xor`), or the one of the `pignistic` image alone; the paper's table II.
    ratio
        Lowe's ratio: a match must be this much nearer than the second best.
    pyramid_step, pyramid_levels, fast_threshold
        ORB's pyramid and corner detector.
    """

    keypoints: Count = 1000
    descriptor: Descriptor = "concatenated"
    ratio: Annotated[float, Field(gt=0.0, le=1.0)] = 0.7
    pyramid_step: Annotated[float, Field(gt=1.0)] = 1.2
    pyramid_levels: Count = 8
    fast_threshold: Annotated[int, Field(ge=0)] = 20


class ConsensusConfig(FrozenConfig):
    """The rigid motion that most matches agree on.

    Parameters
    ----------
    inlier_distance_m
        Farthest apart two matched points may end up [m].
    min_inliers
        Fewer than these are chance.
    min_baseline_m
        Two matches nearer together than this say nothing about a rotation [m].
    max_scale_deviation
        How far from 1 the scale may be that fits the inliers best.
    trials
        Pairs of matches that are tried; all of them where there are fewer.
    seed
        Of the draw, where not all are tried.
    """

    inlier_distance_m: Metres = 0.3
    min_inliers: Annotated[int, Field(ge=2)] = 5
    min_baseline_m: Metres = 1.0
    max_scale_deviation: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.05
    trials: Count = 4000
    seed: int = 0


class StructureConfig(FrozenConfig):
    """What counts as wall and as free space when alignments are judged.

    Parameters
    ----------
    min_wall_mass
        Least mass on occupied; less may be the blur beside a wall.
    min_speck_m
        Shortest connected piece of wall [m]; shorter ones may be people, legs and noise.
    steady_m, movable_m, least_weight
        Pieces of wall at least so long count whole [m]; those shorter than the second, things that people move, count
        for the third.
    gap_m
        Gaps as wide do not part a wall [m].
    block_m
        Solid blocks at least so thick [m] and short are such things too where they stand against a wall.
    thing_m, hollow_m
        Closed outlines as long [m] are such things too; what nobody saw inside is at least so wide, or it is the inside
        of a wall [m].
    """

    min_wall_mass: Share = 0.1
    min_speck_m: Annotated[float, Field(ge=0.0)] = 0.2
    steady_m: Annotated[float, Field(ge=0.0)] = 1.2
    movable_m: Annotated[float, Field(ge=0.0)] = 0.8
    least_weight: Share = 0.1
    gap_m: Annotated[float, Field(ge=0.0)] = 0.1
    block_m: Metres = 0.25
    thing_m: Annotated[float, Field(ge=0.0)] = 1.8
    hollow_m: Metres = 0.45


class CorrelationConfig(FrozenConfig):
    """The search through all rotations and shifts.

    Parameters
    ----------
    cells_along
        Cells along both maps together; large maps are searched more coarsely.
    min_cell_m, max_cell_m, most_cells
        Finest and coarsest cells allowed [m], which limit the former, but for maps so large that they would have more
        cells along them than this.
    clearance_m, clearance_cells
        Free space nearer than this to a wall tolerates walls [m, cells]; the larger of the two holds.
    penalty
        What a metre of wall on free space costs, in metres of agreeing wall.
    wall_bonus
        What a metre of wall on any wall brings.
    turns_share, most_turns
        Share of all rotations that are tried, those under which most walls face the same ways, and how many at most:
        large maps have many, and walls enough to tell which. Of maps that overlap little, most walls are not shared, so
        that the way they face may tell nothing of the truth.
    min_overlap_m
        Shifts under which the maps reach into each other by less are not told apart from others [m].
    peaks_per_rotation, proposals
        Best shifts taken from each rotation, and best motions taken from all.
    semifinalists, finalists
        How many of these are made exact, and how many of those are told apart with all of their walls.
    """

    cells_along: Annotated[int, Field(ge=8)] = 120
    min_cell_m: Metres = 0.2
    max_cell_m: Metres = 0.5
    most_cells: Annotated[int, Field(ge=8)] = 400
    clearance_m: Metres = 0.25
    clearance_cells: Annotated[float, Field(ge=0.0)] = 1.2
    penalty: Annotated[float, Field(ge=0.0)] = 0.5
    wall_bonus: Annotated[float, Field(ge=0.0)] = 0.3
    turns_share: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    most_turns: Count = 220
    min_overlap_m: Annotated[float, Field(ge=0.0)] = 3.0
    peaks_per_rotation: Count = 30
    proposals: Count = 600
    semifinalists: Annotated[int, Field(ge=2)] = 40
    finalists: Annotated[int, Field(ge=2)] = 20


class RefinementConfig(FrozenConfig):
    """How an alignment is made exact.

    Parameters
    ----------
    proposal_reach_m
        How far a wall looks for its like when a proposal of the correlation is refined at first [m].
    first_reach_m, last_reach_m
        How far it looks in the first and in the last iteration of the final refinement [m].
    iterations, rough_iterations
        Steps of the final refinement, and of the first one.
    few_walls, some_walls, many_walls
        How many walls of each map are looked at in the first refinement, to judge its results, and in the final one.
    """

    proposal_reach_m: Metres = 1.2
    first_reach_m: Metres = 0.5
    last_reach_m: Metres = 0.15
    iterations: Annotated[int, Field(ge=0)] = 10
    rough_iterations: Annotated[int, Field(ge=0)] = 10
    few_walls: Annotated[int, Field(ge=3)] = 300
    some_walls: Annotated[int, Field(ge=3)] = 1000
    many_walls: Annotated[int, Field(ge=3)] = 2500


Coordinate = Annotated[float, Field(ge=-MAX_DISTANCE, le=MAX_DISTANCE, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-MAX_TURN, le=MAX_TURN, allow_inf_nan=False)]
KnownPose = tuple[Coordinate, Coordinate, Angle]


class KnownPoseConfig(FrozenConfig):
    """How a map is placed near its known pose.

    Parameters
    ----------
    reach_m, reach_rad
        How far from the known pose the map is searched, at the middle of its walls [m], and how far turned [rad].
    min_wall_m
        With less agreeing wall than this it is laid exactly as told [m].
    """

    PUBLIC: ClassVar = ("reach_m",)

    reach_m: Annotated[float, Field(ge=1e-3, le=1e3)] = 1.0
    reach_rad: Annotated[float, Field(ge=1e-3, le=3.2)] = 0.18
    min_wall_m: Metres = 2.0


class ShortRangeConfig(FrozenConfig):
    """A second registration, by short ranges only, of maps that no alignment joined; see `merging.rounds`.

    Parameters
    ----------
    enabled
        Whether it is tried where maps carry keyframes.
    range_m
        Walls seen from farther off are left out [m]: from here a heading that is wrong by a degree moves a wall as far
        as walls that agree may lie from each other.
    """

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = True
    range_m: Metres = 8.5


class NonrigidConfig(FrozenConfig):
    """Non-rigid registration of pairs that no rigid transform aligns; see `merging.nonrigid.search`.

    Parameters
    ----------
    enabled
        Whether refused pairs are registered non-rigidly.
    side_m
        Approximate side of the tiles of the first round [m]; tiles of later rounds have half of it.
    most
        The largest number of tiles of a map. Larger maps have larger tiles.
    min_lead
        A pair is tried if the correlation scores the best pose higher than the next one by this factor. Of 66 deformed
        pairs of simulated floors that are aligned by it, the smallest factor is 1.08. 60 of 187 pairs of different
        places have less than 1.05. The limit saves a quarter of the time.
    places
        The number of poses of the correlation that are tried.
    rivals
        The number of further poses, and of poses that fit best rigidly, that are deformed too and must not fit as well.
    min_agreement, min_wall_m
        A registered tile is used if this share of its comparable walls agrees, and this length of walls [m].
    farthest_m
        The largest distance of a tile from its initial pose [m].
    clear_lead
        A second attempt tolerates larger distances if the correlation scores the best pose higher than the next one by
        this factor. Of the deformed pairs of simulated floors that only the second attempt aligns, the smallest factor
        is 2.18. One in twenty pairs of different places has more than 2, but fits no better with larger distances.
    wide_agreement_m, wide_conflict_m, wide_see_through_m
        The distances of `VerificationConfig` in the second attempt [m]. `wide_agreement_m` also limits the refinement.
    """

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = True
    side_m: Metres = 16.0
    most: Annotated[int, Field(ge=2)] = 24
    min_lead: Annotated[float, Field(ge=0.0)] = 1.05
    places: Count = 1
    rivals: Count = 8
    min_agreement: Share = 0.5
    min_wall_m: Metres = 3.0
    farthest_m: Metres = 1.0
    clear_lead: Annotated[float, Field(ge=1.0)] = 2.0
    wide_agreement_m: Metres = 0.25
    wide_conflict_m: Metres = 0.45
    wide_see_through_m: Metres = 0.8
