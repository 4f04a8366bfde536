"""The parameters of the grouping of maps, and of the joint optimisation of a group's drives."""

from typing import ClassVar

from pydantic import Field

from tbmslam.frozen_config import Count, FrozenConfig, Metres, Share
from tbmslam.loop_closure.submap import SubmapConfig
from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig


class GraphConfig(FrozenConfig):
    """Grouping of maps by their pose hypotheses."""

    same_m: Metres = Field(1.0, description="poses nearer to each other than this are equal [m]")
    same_rad: float = Field(0.06, gt=0, description="poses with less rotation between them are equal [rad]")
    # The best pose of a refused alignment may always confirm others: a wrong pose rarely agrees with them by chance.
    min_confidence: Share = Field(0.02, description="least confidence of an alternative pose that confirms others")
    min_wall_m: Metres = Field(1.0, description="least agreeing wall of a refused pose that confirms others [m]")
    # Measured on 10,000 triples of maps, two of which show one place. The wrong pose of the third map on one of them
    # agreed with its pose on the other in 30 %, and in 47 % of those with a confidence above 0.1.
    coincidence: float = Field(
        0.4, ge=1e-9, le=1, description="probability that wrong poses of two pairs agree; see `support_of`"
    )
    min_support: float = Field(2.19, description="least log odds at which maps are joined")
    deviation_m: Metres = Field(0.05, description="standard deviation of an alignment without a covariance [m]")
    deviation_rad: float = Field(0.005, gt=0, description="standard deviation of its rotation [rad]")
    robust_width: float = Field(3.0, gt=0, description="deviations from which an alignment loses weight")


class RetrievalConfig(FrozenConfig):
    """Selection of the pairs of many maps that are aligned."""

    # With rounds, one of 24 maps of three real drives was not joined: the pairs that join it overlap little and are
    # not similar.
    few: Count = Field(30, description="largest number of maps of which all pairs are aligned")
    # With 3, 7 and 12 all 30 maps that three real drives were cut into are joined; with 3 and 7 two are not.
    neighbours: tuple[Count, ...] = Field((3, 7, 15), description="most similar maps to align with, for each round")


class JointConfig(FrozenConfig):
    """Joint optimisation of the drives of several robots."""

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = Field(True, description="optimise the drives of maps with keyframes jointly")
    submap: SubmapConfig = Field(SubmapConfig(), description="the parameters of submaps")
    step: Metres = Field(1.0, description="path between keyframes that are registered to other robots' submaps [m]")
    reach_m: Metres = Field(4.0, description="largest distance of a keyframe from the path of a submap [m]")
    submaps_per_step: Count = Field(2, description="nearest submaps that are tried")
    bundle_m: float = Field(1.5, ge=0, description="path before and after a keyframe whose scans form a bundle [m]")
    first_shift_m: Metres = Field(0.8, description="largest distance of the search in the first round [m]")
    last_shift_m: Metres = Field(
        0.3, description="the same in the second round; also of a registration from its initial pose [m]"
    )
    tightenings: int = Field(2, ge=0, description="further rounds without a search")
    min_gap_m: Metres = Field(12.0, description="least path between two visits of a robot to a place [m]")
    turn_rad: float = Field(0.075, gt=0, description="largest rotation of the search [rad]")
    search_points: int = Field(150, ge=10, description="hits of a bundle in the search")
    match_points: int = Field(500, ge=10, description="hits of a bundle in the registration")
    min_matched: Share = Field(0.4, description="least share of matched hits")
    # Objects may have moved between the drives.
    sure_matched: Share = Field(0.58, description="share of matched hits from which a closure has its full weight")
    doubtful_weight: float = Field(0.1, gt=0, le=1, description="weight of a closure with fewer matched hits")
    max_violated: Share = Field(0.2, description="most hits in free space for each matched hit")
    max_ambiguity: Share = Field(0.9, description="largest score of another pose, as a share of the best")
    min_determined: float = Field(
        0.02, ge=0, description="least curvature of a determined direction, as a share of the other direction's"
    )
    min_closures: Count = Field(5, description="least number of closures; with fewer the alignment stays rigid")
    # The motions of a drive that did not store them are derived from its poses.
    step_m: Metres = Field(0.01, description="standard deviation of a motion between keyframes [m]")
    step_rad: float = Field(0.003, gt=0, description="the same of its rotation [rad]")
    crossing_m: Metres = Field(0.05, description="standard deviation where a drive crosses its path [m]")
    crossing_rad: float = Field(0.01, gt=0, description="the same of the rotation [rad]")
    stiffness_step_m: Metres = Field(2.0, description="path between places that are compared for crossings [m]")
    stiffness_reach_m: Metres = Field(3.0, description="largest distance between the two passages [m]")
    closure_m: Metres = Field(0.02, description="least standard deviation of a closure [m]")
    closure_rad: float = Field(0.004, gt=0, description="the same of its rotation [rad]")
    robust_width: float = Field(2.0, gt=0, description="deviations from which a closure loses weight")
    adjustment: AdjustmentConfig = Field(AdjustmentConfig(), description="optimisation of poses and wall lines")
