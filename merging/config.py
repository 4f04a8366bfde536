"""Every number a merge depends on, with its default."""

from typing import Annotated, Literal

from pydantic import Field

from merging.baselines.config import BaselinesConfig
from merging.bending_config import BentLookConfig, JointConfig, NearConfig
from tbmslam.files.map_check import MAX_DISTANCE, MAX_TURN
from tbmslam.frozen_config import Count, FrozenConfig, Metres, Share
from tbmslam.wall_limits import FACING, Limits

Method = Literal["correlation", "features", "birk-carpin", "carpin", "li", "saeedi", "trehard", "dobrokhvalov-filatov"]
Descriptor = Literal["concatenated", "and", "or", "xor", "pignistic"]
Rule = Literal[
    "disjunctive",
    "conjunctive",
    "dempster",
    "dubois-prade",
    "yager",
    "average",
    "unanimous",
    "log-odds",
    "entropy-filter",
]
Coverage = Literal["union", "overlap"]


Coordinate = Annotated[float, Field(ge=-MAX_DISTANCE, le=MAX_DISTANCE, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-MAX_TURN, le=MAX_TURN, allow_inf_nan=False)]
KnownPose = tuple[Coordinate, Coordinate, Angle]


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


class VerificationConfig(FrozenConfig):
    """When an alignment is believed.

    Parameters
    ----------
    agreement_distance_m
        How near to a wall of the other map, seen from the same side, a wall must lie to agree [m].
    conflict_distance_m
        How far from every wall of the other map a wall on its free space must lie to contradict it [m].
    see_through_m
        A map that knows so much free space before and behind a wall, and nothing else, saw through it [m].
    front_m
        How far before a wall the other robot must have seen free space to have seen the wall [m].
    other_weight
        What a metre of wall that the other robot should have seen where it is, and did not, costs when candidates are
        chosen, in metres of agreeing wall.
    min_confidence
        Least probability of an alignment that is accepted.
    min_overlap_m2
        Least area known to both maps.
    min_ambiguous_wall_m, min_ambiguous_agreement, ambiguous_share
        Refused maps are called ambiguous, and not foreign, where the best place has so much agreeing wall, such a share
        of the compared walls agrees, and another place is at least so likely, as a share of the best one's.
    """

    agreement_distance_m: Metres = 0.15
    conflict_distance_m: Metres = 0.3
    see_through_m: Metres = 0.5
    front_m: Metres = 0.3
    other_weight: Annotated[float, Field(ge=0.0)] = 0.6
    min_confidence: Share = 0.85
    min_overlap_m2: Annotated[float, Field(ge=0.0)] = 2.0
    min_ambiguous_wall_m: Annotated[float, Field(ge=0.0)] = 8.0
    min_ambiguous_agreement: Share = 0.7
    ambiguous_share: Share = 0.3

    def limits(self) -> Limits:
        """Return the distances as the kernels take them."""
        return Limits(self.agreement_distance_m, self.conflict_distance_m, self.front_m, FACING)


class ExactnessConfig(FrozenConfig):
    """How exactly agreeing walls tell where a map lies; see `merging.exactness`.

    Parameters
    ----------
    wall_m
        Standard deviation of where a metre of wall lies beside where it should, in two maps that are bent [m].
    place_m, turn_rad
        Standard deviations of an alignment that was found, before any wall is counted.
    bend_m, bend_rad
        What stays however many walls agree: maps have cells, and long drives bend as a whole [m], [rad].
    """

    wall_m: Annotated[float, Field(ge=1e-4, le=1e3)] = 0.08
    place_m: Annotated[float, Field(ge=1e-4, le=1e3)] = 0.075
    turn_rad: Annotated[float, Field(ge=1e-4, le=1e1)] = 0.0285
    bend_m: Annotated[float, Field(ge=1e-4, le=1e3)] = 0.015
    bend_rad: Annotated[float, Field(ge=1e-5, le=1e1)] = 0.003


class GraphConfig(FrozenConfig):
    """How maps are joined to groups.

    Parameters
    ----------
    same_m, same_rad
        Alignments nearer to each other than this name one place.
    min_confidence
        Least probability of an alternative that may confirm others. The best place of a refused alignment always may:
        of the many places that chance could have chosen, it chose the one that others lead to.
    min_wall_m
        With less agreeing wall than this a place that was refused confirms nothing [m].
    coincidence
        Chance that the wrong place of one pair is that of others too, whose maps show the same: what a confirmation is
        worth, see `merging.offers.worth_of`. Of 10,000 threes of maps, two of them of one place, the third laid onto
        one of these wrongly, it lay alike on the other in 30 %, and in 47 % where its confidence was above 0.1.
    min_support
        Least log odds at which maps are joined.
    sure_alone, min_whole
        An accepted alignment with less confidence than the first that alone joins two groups is refused if these, each
        as one map, give its place less than the second; see `merging.lone_joins`.
    deviation_m, deviation_rad
        Standard deviation of an alignment whose method states none.
    robust_width
        Deviations at which an alignment begins to lose its say.
    """

    same_m: Metres = 1.0
    same_rad: Annotated[float, Field(gt=0.0)] = 0.06
    min_confidence: Share = 0.02
    min_wall_m: Metres = 1.0
    coincidence: Annotated[float, Field(ge=1e-9, le=1.0)] = 0.4
    min_support: float = 2.19
    sure_alone: Share = 0.99
    min_whole: Share = 0.1
    deviation_m: Metres = 0.05
    deviation_rad: Annotated[float, Field(gt=0.0)] = 0.005
    robust_width: Annotated[float, Field(gt=0.0)] = 3.0


class KnownPoseConfig(FrozenConfig):
    """How a map is laid near a pose that somebody knows.

    Parameters
    ----------
    reach_m, reach_rad
        How far from the told pose it is looked for, at the middle of its walls [m], and how far turned [rad].
    min_wall_m
        With less agreeing wall than this it is laid exactly as told [m].
    """

    reach_m: Annotated[float, Field(ge=1e-3, le=1e3)] = 1.0
    reach_rad: Annotated[float, Field(ge=1e-3, le=3.2)] = 0.18
    min_wall_m: Metres = 2.0


class MergeConfig(FrozenConfig):
    """How maps are merged.

    Parameters
    ----------
    method
        How two maps find each other: `correlation` tries every rotation and shift, `features` is the paper's, and the
        others are `merging.baselines`.
    rule
        How beliefs about one cell become one: `disjunctive` (eq. 6), `conjunctive` (eq. 5), `dempster`,
        `dubois-prade`, `yager`, `average`, `unanimous`, `log-odds` or `entropy-filter`; see `merging.fusion.fuse`. None
        renders the merged map anew from all scans where the drives were straightened together, the coverage is
        `union`, every map is believed and all were rendered alike; elsewhere it is `disjunctive`.
    coverage
        `union` keeps the cells that only one robot saw as that robot left them; `overlap` makes them unknown.
    reliability
        Probability that a map, by name, is to be believed at all; 1 for those not named.
    known_poses
        Where maps, by name, lie in the frame of the first, roughly [m, m, rad]: these are laid there and not searched.
    resolution
        Cell size at which maps are compared [m]; None takes the coarser one's of each pair.
    merged_resolution
        Cell size of the merged map [m]; None takes that of the map whose frame it has.
    decoys
        The first glance at the places of the source's mirror image, which tell what chance achieves; where it leaves
        doubt they are searched as `correlation` says. See `merging.judging`.
    """

    method: Method = "correlation"
    rule: Rule | None = None
    coverage: Coverage = "union"
    reliability: dict[str, Share] = Field(default_factory=dict)
    known_poses: dict[str, KnownPose] = Field(default_factory=dict)
    resolution: Metres | None = None
    merged_resolution: Metres | None = None
    features: FeatureConfig = FeatureConfig()
    consensus: ConsensusConfig = ConsensusConfig()
    structure: StructureConfig = StructureConfig()
    correlation: CorrelationConfig = CorrelationConfig()
    decoys: CorrelationConfig = CorrelationConfig(
        cells_along=90,
        min_cell_m=0.1,
        clearance_cells=1.6,
        turns_share=0.3,
        most_turns=120,
        proposals=150,
        semifinalists=6,
        finalists=3,
    )
    refinement: RefinementConfig = RefinementConfig()
    verification: VerificationConfig = VerificationConfig()
    exactness: ExactnessConfig = ExactnessConfig()
    graph: GraphConfig = GraphConfig()
    known: KnownPoseConfig = KnownPoseConfig()
    bent: BentLookConfig = BentLookConfig()
    near: NearConfig = NearConfig()
    joint: JointConfig = JointConfig()
    baselines: BaselinesConfig = BaselinesConfig()
