"""The parameters of the registration of two maps and of its verification."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from tbmslam.frozen_config import Count, FrozenConfig, Metres, Share
from tbmslam.kernels.grids.walls import FACING, Limits
from tbmslam.map.map_check import MAX_DISTANCE, MAX_TURN

Descriptor = Literal["concatenated", "and", "or", "xor", "pignistic"]
"""Combination of the descriptors of a keypoint in several images of a map."""


class FeatureConfig(FrozenConfig):
    """Keypoints and their matches: the paper's parameters, and OpenCV's where the paper states none."""

    keypoints: Count = Field(1000, description="wanted keypoints of each map")
    # Of the occupied, free and unknown image, concatenated or combined bitwise; the paper's table II.
    descriptor: Descriptor = Field("concatenated", description="combination of the descriptors of several images")
    ratio: float = Field(0.7, gt=0, le=1, description="Lowe's ratio: largest distance relative to the second match")
    pyramid_step: float = Field(1.2, gt=1, description="scale between levels of ORB's pyramid")
    pyramid_levels: Count = Field(8, description="levels of ORB's pyramid")
    fast_threshold: int = Field(20, ge=0, description="threshold of ORB's corner detector")


class ConsensusConfig(FrozenConfig):
    """The rigid motion that most matches agree on."""

    inlier_distance_m: Metres = Field(0.3, description="largest distance of matched points after the motion [m]")
    min_inliers: int = Field(5, ge=2, description="least number of inliers")
    min_baseline_m: Metres = Field(1.0, description="least distance of two matches that propose a rotation [m]")
    max_scale_deviation: float = Field(0.05, gt=0, lt=1, description="largest deviation of the fitted scale from 1")
    trials: Count = Field(4000, description="largest number of pairs of matches that are tried")
    seed: int = Field(0, description="seed of their random choice")


class StructureConfig(FrozenConfig):
    """Criteria for walls, free cells, and movable objects."""

    min_wall_mass: Share = Field(0.1, description="least occupied mass of a wall; less may be blur beside it")
    min_speck_m: float = Field(0.2, ge=0, description="least length of a connected piece; less may be a person [m]")
    steady_m: float = Field(1.2, ge=0, description="length from which a piece has full weight [m]")
    movable_m: float = Field(0.8, ge=0, description="length below which a piece is a movable object [m]")
    least_weight: Share = Field(0.1, description="weight of movable objects")
    gap_m: float = Field(0.1, ge=0, description="largest gap that does not divide a wall [m]")
    block_m: Metres = Field(0.25, description="least thickness of a short solid block, which is movable [m]")
    thing_m: float = Field(1.8, ge=0, description="largest side of a closed outline that is movable [m]")
    hollow_m: Metres = Field(0.45, description="least width of an unseen inside; less is the core of a wall [m]")


class CorrelationConfig(FrozenConfig):
    """The search over all rotations and shifts."""

    cells_along: int = Field(120, ge=8, description="cells along both maps; larger maps have larger cells")
    min_cell_m: Metres = Field(0.2, description="smallest cell [m]")
    max_cell_m: Metres = Field(0.5, description="largest cell, unless a map exceeds `most_cells` [m]")
    most_cells: int = Field(400, ge=8, description="largest number of cells along both maps")
    # Free space near a wall tolerates walls; the larger clearance holds.
    clearance_m: Metres = Field(0.25, description="distance to walls below which free space does not count [m]")
    clearance_cells: float = Field(1.2, ge=0, description="the same distance [cells]")
    penalty: float = Field(0.5, ge=0, description="cost of a metre of wall on free space, in metres of agreeing wall")
    wall_bonus: float = Field(0.3, ge=0, description="gain of a metre of wall on any wall")
    # Rotations are ranked by the directions of the walls. If maps overlap little, most walls are not shared, and
    # their directions may not identify the true rotation.
    turns_share: float = Field(1.0, gt=0, le=1, description="share of all rotations that are tried")
    most_turns: Count = Field(220, description="largest number of rotations that are tried")
    min_overlap_m: float = Field(3.0, ge=0, description="least overlap of the maps' extents [m]")
    peaks_per_rotation: Count = Field(30, description="best shifts of each rotation")
    proposals: Count = Field(600, description="best motions of all rotations")
    semifinalists: int = Field(40, ge=2, description="motions that are refined")
    finalists: int = Field(20, ge=2, description="motions that are compared by all of their walls")


class RefinementConfig(FrozenConfig):
    """The refinement of an alignment."""

    proposal_reach_m: Metres = Field(1.2, description="largest distance of matched walls for a proposal [m]")
    first_reach_m: Metres = Field(0.5, description="the same in the first iteration of the final refinement [m]")
    last_reach_m: Metres = Field(0.15, description="the same in its last iteration [m]")
    iterations: int = Field(10, ge=0, description="iterations of the final refinement")
    rough_iterations: int = Field(10, ge=0, description="iterations of the first refinement")
    few_walls: int = Field(300, ge=3, description="walls of each map in the first refinement")
    some_walls: int = Field(1000, ge=3, description="walls of each map that score its results")
    many_walls: int = Field(2500, ge=3, description="walls of each map in the final refinement")


class VerificationConfig(FrozenConfig):
    """When an alignment is accepted."""

    PUBLIC: ClassVar = ("min_confidence", "min_overlap_m2")

    agreement_distance_m: Metres = Field(0.15, description="largest distance of walls that agree [m]")
    conflict_distance_m: Metres = Field(0.3, description="least distance from all walls of a conflict [m]")
    see_through_m: Metres = Field(0.5, description="free space before and behind a wall that was seen through [m]")
    front_m: Metres = Field(0.3, description="distance before a wall that must be free for the wall to be seen [m]")
    other_weight: float = Field(
        0.6, ge=0, description="cost of a metre of wall that does not agree, in metres of agreeing wall"
    )
    min_confidence: Share = Field(
        0.85, description="least probability of an accepted alignment, of two maps or two groups"
    )
    min_overlap_m2: float = Field(2.0, ge=0, description="least area known to both maps [m^2]")
    # A refused pair is called ambiguous, and not foreign, if its best pose fits well and another pose is as likely.
    min_ambiguous_wall_m: float = Field(8.0, ge=0, description="least agreeing wall of an ambiguous pair [m]")
    min_ambiguous_agreement: Share = Field(0.7, description="least agreement of an ambiguous pair")
    ambiguous_share: Share = Field(0.3, description="least probability of the other pose, as a share of the best")

    def limits(self) -> Limits:
        """Return the distances in the form that the kernels take."""
        return Limits(self.agreement_distance_m, self.conflict_distance_m, self.front_m, FACING)


class ExactnessConfig(FrozenConfig):
    """The accuracy of an alignment; see `merging.alignment`."""

    wall_m: float = Field(0.08, ge=1e-4, le=1e3, description="standard deviation of a metre of agreeing wall [m]")
    place_m: float = Field(0.075, ge=1e-4, le=1e3, description="prior standard deviation of the position [m]")
    turn_rad: float = Field(0.0285, ge=1e-4, le=1e1, description="prior standard deviation of the rotation [rad]")
    # The error that remains with any number of walls: maps have cells, and long drives are bent.
    bend_m: float = Field(0.015, ge=1e-4, le=1e3, description="standard deviation by distortion [m]")
    bend_rad: float = Field(0.003, ge=1e-5, le=1e1, description="standard deviation by distortion [rad]")


Coordinate = Annotated[float, Field(ge=-MAX_DISTANCE, le=MAX_DISTANCE, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-MAX_TURN, le=MAX_TURN, allow_inf_nan=False)]
KnownPose = tuple[Coordinate, Coordinate, Angle]


class KnownPoseConfig(FrozenConfig):
    """The placement of a map near its known pose."""

    PUBLIC: ClassVar = ("reach_m",)

    reach_m: float = Field(
        1.0, ge=1e-3, le=1e3, description="largest distance from the known pose, at the centroid of the walls [m]"
    )
    reach_rad: float = Field(0.18, ge=1e-3, le=3.2, description="largest rotation from the known pose [rad]")
    min_wall_m: Metres = Field(2.0, description="least agreeing wall for a refinement of the known pose [m]")


class ShortRangeConfig(FrozenConfig):
    """A second registration, by short ranges only, of maps that no alignment joined; see `merging.rounds`."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="register maps with keyframes again by short ranges")
    # At this range a heading error of a degree moves a wall by the largest distance of agreeing walls.
    range_m: Metres = Field(8.5, description="largest range of walls [m]")


class NonrigidConfig(FrozenConfig):
    """Non-rigid registration of pairs that no rigid transform aligns well; see `merging.nonrigid.search`."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="register refused pairs non-rigidly")
    side_m: Metres = Field(16.0, description="approximate side of the tiles; later rounds have half of it [m]")
    most: int = Field(24, ge=2, description="largest number of tiles of a map")
    # Of 66 deformed pairs of simulated floors that are aligned by it, the smallest factor is 1.08. 60 of 187 pairs of
    # different places have less than 1.05. The limit saves a quarter of the time. It does not apply to likely pairs.
    min_lead: float = Field(1.05, ge=0, description="least score of the best pose relative to the next one's")
    places: Count = Field(8, description="poses of the correlation from which a deformation starts")
    rivals: Count = Field(8, description="further poses that are deformed too and must not fit as well")
    min_agreement: Share = Field(0.5, description="least agreement of a registered tile")
    min_wall_m: Metres = Field(3.0, description="least agreeing wall of a registered tile [m]")
    farthest_m: Metres = Field(1.0, description="largest distance of a tile from its initial pose [m]")
    # Registered tiles leave some distance between corresponding walls. An earlier attempt with the distances of rigid
    # maps would accept 2 more of 252 deformed pairs, but the mean error would be larger by a tenth.
    agreement_distance_m: Metres = Field(0.25, description="largest distance of agreeing walls of refused pairs [m]")
    conflict_distance_m: Metres = Field(0.45, description="least distance of a conflict [m]")
    see_through_m: Metres = Field(0.8, description="free space before and behind a wall seen through [m]")
