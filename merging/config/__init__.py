"""All parameters of a merge, with their defaults."""

from typing import ClassVar, Literal

from pydantic import Field

from merging.config.groups import GraphConfig, JointConfig, RetrievalConfig
from merging.config.registration import (
    ConsensusConfig,
    CorrelationConfig,
    ExactnessConfig,
    FeatureConfig,
    KnownPose,
    KnownPoseConfig,
    NonrigidConfig,
    RefinementConfig,
    ShortRangeConfig,
    StructureConfig,
    VerificationConfig,
)
from tbmslam.frozen_config import Count, FrozenConfig, Metres, Share

Method = Literal["correlation", "features", "birk-carpin", "carpin", "li", "saeedi", "trehard", "dobrokhvalov-filatov"]
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


class BirkCarpinConfig(FrozenConfig):
    """Adaptive random walk on the image similarity."""

    walkers: Count = Field(64, description="random walks")
    steps: Count = Field(300, description="steps of each walk")
    memory: Count = Field(8, description="number of accepted steps from which a walk adapts its next steps")
    daring: Share = Field(0.05, description="probability that a worse step is accepted")
    sample: Count = Field(200, description="cells of each map and state that are compared in a step")
    lock: float = Field(100.0, ge=0, description="cost if all cells disagree, or gain if all agree [cells]")
    max_index: Share = Field(0.06, description="largest accepted acceptance index, 1 - agr / (agr + dis)")
    seed: int = Field(0, description="seed of the walks")


class CarpinConfig(FrozenConfig):
    """Hough spectra."""

    turns: Count = Field(6, description="rotations that the spectra propose")
    peaks: Count = Field(6, description="peaks along x and along y for each rotation")
    penalty: float = Field(3.0, ge=0, description="cost of a disagreeing cell, in agreeing cells")
    max_index: Share = Field(0.045, description="largest accepted acceptance index")


class LiConfig(FrozenConfig):
    """Occupancy likelihood, maximised by a genetic algorithm."""

    population: int = Field(400, ge=5, description="size of the population")
    generations: Count = Field(200, description="number of generations")
    sample: Count = Field(500, description="walls and free cells of the source that are compared")
    blur_m: Metres = Field(0.15, description="standard deviation of the target's blurred likelihood [m]")
    min_likelihood: Share = Field(0.79, description="least accepted mean likelihood of walls in the known area")
    seed: int = Field(0, description="seed of the algorithm")


class SaeediConfig(FrozenConfig):
    """Probabilistic generalised Voronoi diagrams."""

    min_apart_m: Metres = Field(0.5, description="least distance of two walls with a diagram cell between them [m]")
    turns: Count = Field(6, description="rotations that the Hough spectra of the diagrams propose")
    peaks: Count = Field(8, description="shifts for each rotation")
    cell_m: Metres = Field(0.2, description="cells of the correlation [m]")
    min_gain: Share = Field(0.94, description="least accepted share of the overlap whose entropy decreases")


class TrehardConfig(FrozenConfig):
    """Consistency of masses by the disjunctive operator."""

    turns: Count = Field(180, description="rotations that are tried")
    peaks: Count = Field(4, description="best shifts of each rotation")
    cells_along: int = Field(180, ge=8, description="cells along both maps together in the search")
    finalists: Count = Field(24, description="best motions that are refined")
    sample: Count = Field(1500, description="walls of each map that are compared in the refinement")
    min_consistency: Share = Field(0.72, description="least accepted consistency")


class BaselinesConfig(FrozenConfig):
    """Methods of the related work.

    Each limit of acceptance maximises the right less the wrong alignments on pairs cut from ten simulated buildings
    (`tools/make_map_pairs.py`, five kinds, 150 m2 each). No real map was used for the limits. The extent of the
    searches, and Carpin's penalty, were chosen after a look at a few real pairs.
    """

    min_overlap_share: Share = Field(0.1, description="least accepted overlap, as a share of the smaller known area")
    birk_carpin: BirkCarpinConfig = BirkCarpinConfig()
    carpin: CarpinConfig = CarpinConfig()
    li: LiConfig = LiConfig()
    saeedi: SaeediConfig = SaeediConfig()
    trehard: TrehardConfig = TrehardConfig()


class MergeConfig(FrozenConfig):
    """The parameters of a merge."""

    PUBLIC: ClassVar = ("method", "rule", "coverage", "reliability", "known_poses", "resolution", "merged_resolution")

    method: Method = Field(
        "correlation",
        description="registration of two maps: `correlation` tries every rotation and translation, `features` is the "
        "paper's method, and the others are `merging.baselines`",
    )
    rule: Rule | None = Field(
        None,
        description="fusion of the masses of a cell: `disjunctive` (eq. 6), `conjunctive` (eq. 5), `dempster`, "
        "`dubois-prade`, `yager`, `average`, `unanimous`, `log-odds` or `entropy-filter`; see `merging.fusion.fuse`. "
        "Without a rule the merged map is rendered again from all scans if the drives were optimised jointly, the "
        "coverage is `union`, all maps are fully reliable, and all were rendered alike; else it is `disjunctive`",
    )
    coverage: Coverage = Field(
        "union", description="`union` keeps the cells that only one robot saw; `overlap` makes them unknown"
    )
    reliability: dict[str, Share] = Field(
        default_factory=dict, description="reliability of maps by name, from 0 to 1; 1 for maps that are not named"
    )
    known_poses: dict[str, KnownPose] = Field(
        default_factory=dict,
        description="approximate poses of maps, by name, in the frame of the first map [m, m, rad]; these maps are "
        "not searched",
    )
    resolution: Metres | None = Field(
        None, description="cell size at which maps are compared [m]; without it the larger one of each pair"
    )
    merged_resolution: Metres | None = Field(
        None, description="cell size of the merged map [m]; without it that of the first merged map"
    )
    features: FeatureConfig = FeatureConfig()
    consensus: ConsensusConfig = ConsensusConfig()
    structure: StructureConfig = StructureConfig()
    correlation: CorrelationConfig = CorrelationConfig()
    # The coarse search for poses of the source's mirror image; see `merging.scoring`.
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
    covariance: ExactnessConfig = ExactnessConfig()
    retrieval: RetrievalConfig = RetrievalConfig()
    graph: GraphConfig = GraphConfig()
    pose_priors: KnownPoseConfig = KnownPoseConfig()
    nonrigid: NonrigidConfig = NonrigidConfig()
    short_range: ShortRangeConfig = ShortRangeConfig()
    joint: JointConfig = JointConfig()
    baselines: BaselinesConfig = BaselinesConfig()

    def of_deformed_maps(self) -> "MergeConfig":
        """Return the parameters with the larger distances at which the walls of deformed maps agree."""
        distances = {
            "agreement_distance_m": self.nonrigid.agreement_distance_m,
            "conflict_distance_m": self.nonrigid.conflict_distance_m,
            "see_through_m": self.nonrigid.see_through_m,
        }
        return self.model_copy(
            update={
                "verification": self.verification.model_copy(update=distances),
                "refinement": self.refinement.model_copy(update={"last_reach_m": self.nonrigid.agreement_distance_m}),
            }
        )


PAPER = MergeConfig(
    method="dobrokhvalov-filatov",
    rule="disjunctive",
    coverage="overlap",
    nonrigid=NonrigidConfig(enabled=False),
    joint=JointConfig(enabled=False),
)
"""The paper's algorithm 1: keypoints, one motion for the whole map, the disjunctive rule (eq. 6).

The motion is neither verified nor refined, no map is deformed, and no scan is rendered again. A cell that any map does
not know is unknown in the merged map (its figure 2e).
"""
