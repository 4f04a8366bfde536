"""Every number a merge depends on, with its default."""

from typing import ClassVar, Literal

from pydantic import Field

from merging.config.baselines import BaselinesConfig
from merging.config.groups import GraphConfig, JointConfig, RetrievalConfig
from merging.config.registration import (
    ConsensusConfig,
    CorrelationConfig,
    FeatureConfig,
    KnownPose,
    KnownPoseConfig,
    NonrigidConfig,
    RefinementConfig,
    ShortRangeConfig,
    StructureConfig,
)
from merging.config.verification import ExactnessConfig, VerificationConfig
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
    """How maps are merged.

    Parameters
    ----------
    method
        How two maps are aligned: `correlation` tries every rotation and shift, `features` is the paper's, and the
        others are `merging.baselines`.
    rule
        How beliefs about one cell become one: `disjunctive` (eq. 6), `conjunctive` (eq. 5), `dempster`,
        `dubois-prade`, `yager`, `average`, `unanimous`, `log-odds` or `entropy-filter`; see
        `merging.fusion.fuse`. None renders the merged map anew from all scans where the drives were straightened
        together, the coverage is `union`, every map is believed and all were rendered alike; elsewhere it is
        `disjunctive`.
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
        doubt they are searched as `correlation` says. See `merging.scoring.decoys`.
    """

    PUBLIC: ClassVar = ("method", "rule", "coverage", "reliability", "known_poses", "resolution", "merged_resolution")

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
"""The paper's algorithm 1 and nothing else: keypoints, one motion for the whole map, the disjunctive rule (eq. 6).

Nothing confirms or refines the motion, no map is deformed, and no scan is rendered again. Any cell that a map does not
know is unknown in the merged map (its figure 2e).
"""
