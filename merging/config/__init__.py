"""All parameters of a merge, with their defaults."""

from typing import ClassVar, Literal

from pydantic import Field

from merging.config.baselines import BaselinesConfig
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
from tbmslam.frozen_config import FrozenConfig, Metres, Share

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
