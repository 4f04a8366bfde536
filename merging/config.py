"""Every number a merge depends on, with its default."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Method = Literal["correlation", "features"]
Descriptor = Literal["concatenated", "and", "or", "xor", "pignistic"]
Rule = Literal["disjunctive", "conjunctive", "dempster"]
Coverage = Literal["union", "overlap"]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Metres = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class _Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class FeatureConfig(_Config):
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

    keypoints: Annotated[int, Field(ge=1)] = 1000
    descriptor: Descriptor = "concatenated"
    ratio: Annotated[float, Field(gt=0.0, le=1.0)] = 0.7
    pyramid_step: Annotated[float, Field(gt=1.0)] = 1.2
    pyramid_levels: Annotated[int, Field(ge=1)] = 8
    fast_threshold: Annotated[int, Field(ge=0)] = 20


class ConsensusConfig(_Config):
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
    trials: Annotated[int, Field(ge=1)] = 4000
    seed: int = 0


class StructureConfig(_Config):
    """What counts as wall and as free space when alignments are judged.

    Parameters
    ----------
    min_wall_mass
        Least mass on occupied; less may be the blur beside a wall.
    min_speck_m
        Shortest connected piece of wall [m]; shorter ones may be people, legs and noise.
    """

    min_wall_mass: Share = 0.1
    min_speck_m: Annotated[float, Field(ge=0.0)] = 0.2


class CorrelationConfig(_Config):
    """The search through all rotations and shifts.

    Parameters
    ----------
    cells_along
        Cells along both maps together; large maps are searched more coarsely.
    max_cell_m
        Coarsest cells allowed [m], which limits the former.
    clearance_m, clearance_cells
        Free space nearer than this to a wall tolerates walls [m, cells]; the larger of the two holds.
    penalty
        What a metre of wall on free space costs, in metres of agreeing wall.
    wall_bonus
        What a metre of wall on any wall brings.
    peaks_per_rotation, proposals
        Best shifts taken from each rotation, and best motions taken from all.
    finalists
        How many of these are refined with all of their walls.
    """

    cells_along: Annotated[int, Field(ge=8)] = 180
    max_cell_m: Metres = 0.3
    clearance_m: Metres = 0.25
    clearance_cells: Annotated[float, Field(ge=0.0)] = 1.6
    penalty: Annotated[float, Field(ge=0.0)] = 0.5
    wall_bonus: Annotated[float, Field(ge=0.0)] = 0.3
    peaks_per_rotation: Annotated[int, Field(ge=1)] = 12
    proposals: Annotated[int, Field(ge=1)] = 100
    finalists: Annotated[int, Field(ge=2)] = 12


class RefinementConfig(_Config):
    """How an alignment is made exact.

    Parameters
    ----------
    first_reach_m, last_reach_m
        How far a wall looks for its like in the first and in the last iteration [m].
    iterations, rough_iterations
        Steps from one to the other, and those for a proposal of which little is hoped.
    """

    first_reach_m: Metres = 0.5
    last_reach_m: Metres = 0.15
    iterations: Annotated[int, Field(ge=0)] = 15
    rough_iterations: Annotated[int, Field(ge=0)] = 6


class VerificationConfig(_Config):
    """When an alignment is believed.

    Parameters
    ----------
    agreement_distance_m
        How near to a wall of the other map, seen from the same side, a wall must lie to agree [m].
    conflict_distance_m
        How far from every wall of the other map a wall on its free space must lie to contradict it [m].
    min_overlap_m2
        Least area known to both maps.
    min_agreed_wall_m
        Least length of wall that agrees.
    min_weakest_wall_m
        Least length of agreeing wall across the direction in which the maps could slide most easily.
    min_agreement
        Least share of the walls in the overlap that agree.
    max_conflict, max_conflict_bent, bent_weakest_wall_m
        Largest share of the walls in the overlap that contradict. Two drives bend their maps differently, and in a
        large overlap walls then contradict although the place is beyond doubt: where more wall resists the easiest
        slide than chance ever brings together, the second limit holds.
    conflict_weight
        What a metre of contradicting wall costs when alignments are compared, in metres of agreeing wall.
    max_rival
        Largest support of an alignment elsewhere, as a share of the best one's; above it the maps are ambiguous.
    """

    agreement_distance_m: Metres = 0.15
    conflict_distance_m: Metres = 0.3
    min_overlap_m2: Annotated[float, Field(ge=0.0)] = 4.0
    min_agreed_wall_m: Annotated[float, Field(ge=0.0)] = 10.0
    min_weakest_wall_m: Annotated[float, Field(ge=0.0)] = 5.0
    min_agreement: Share = 0.55
    max_conflict: Share = 0.2
    max_conflict_bent: Share = 0.35
    bent_weakest_wall_m: Annotated[float, Field(ge=0.0)] = 30.0
    conflict_weight: Annotated[float, Field(ge=0.0)] = 2.0
    max_rival: Share = 0.7


class MergeConfig(_Config):
    """How maps are merged.

    Parameters
    ----------
    method
        How two maps find each other: `correlation` tries every rotation and shift, `features` is the paper's.
    rule
        How two beliefs about one cell become one: `disjunctive` (eq. 6), `conjunctive` (eq. 5) or `dempster`.
    coverage
        `union` keeps the cells that only one robot saw as that robot left them; `overlap` makes them unknown.
    resolution
        Cell size at which maps are compared [m]; None takes the coarsest map's.
    merged_resolution
        Cell size of the merged map [m]; None takes that of the map whose frame it has.
    """

    method: Method = "correlation"
    rule: Rule = "disjunctive"
    coverage: Coverage = "union"
    resolution: Metres | None = None
    merged_resolution: Metres | None = None
    features: FeatureConfig = FeatureConfig()
    consensus: ConsensusConfig = ConsensusConfig()
    structure: StructureConfig = StructureConfig()
    correlation: CorrelationConfig = CorrelationConfig()
    refinement: RefinementConfig = RefinementConfig()
    verification: VerificationConfig = VerificationConfig()
