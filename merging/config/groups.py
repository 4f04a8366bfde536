"""Parameters of the grouping of maps, and of the joint optimisation of a group's drives."""

from typing import Annotated, ClassVar

from pydantic import Field

from tbmslam.frozen_config import Count, FrozenConfig, Metres, Share
from tbmslam.loop_closure.submap import SubmapConfig
from tbmslam.optimisation.config import AdjustmentConfig


class GraphConfig(FrozenConfig):
    """Grouping of maps by their pose hypotheses.

    Parameters
    ----------
    same_m, same_rad
        Poses nearer to each other than this are one pose.
    min_confidence
        Least confidence of an alternative pose that may confirm others. The best pose of a refused alignment may always
        confirm others: it would be a rare coincidence that a wrong pose agrees with them.
    min_wall_m
        Least agreeing wall of a refused pose that confirms others [m].
    coincidence
        Probability that a wrong pose of one pair agrees with wrong poses of other pairs. It is the weight of a
        confirmation, see `merging.map_graph.hypothesis.support_of`. It was measured on 10,000 triples of maps, two of
        which show one place. The wrong pose of the third map on one of them agreed with its pose on the other in 30 %,
        and in 47 % of those with a confidence above 0.1.
    min_support
        Least log odds at which maps are joined.
    sure_alone, min_whole
        A bridge joins two groups by one accepted alignment with less confidence than `sure_alone`. It is refused if the
        registration of both groups as wholes gives its pose less confidence than `min_whole`; see `merging.bridges`.
    deviation_m, deviation_rad
        Standard deviation of an alignment without a covariance.
    robust_width
        Number of standard deviations from which the weight of an alignment decreases.
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


class RetrievalConfig(FrozenConfig):
    """Which pairs of many maps are aligned.

    Parameters
    ----------
    few
        Largest number of maps of which all pairs are aligned. With rounds, one of 24 maps of three real drives was not
        joined, since the pairs that join it overlap little and are not similar.
    neighbours
        The number of most similar maps with which each map is aligned, for each round. With 3, 7 and 12 all 30 maps
        that three real drives were cut into are joined; with 3 and 7 two of them are not.
    """

    PUBLIC: ClassVar = ()

    few: Count = 30
    neighbours: tuple[Count, ...] = (3, 7, 15)


class JointConfig(FrozenConfig):
    """Joint optimisation of the drives of several robots.

    Parameters
    ----------
    enabled
        Whether the drives of maps with keyframes are optimised jointly.
    submap
        The parameters of submaps.
    step
        Travelled distance between keyframes that are registered to submaps of other robots [m].
    reach_m, submaps_per_step
        Largest distance of a keyframe from the path of a submap [m], and number of nearest submaps that are tried.
    bundle_m
        A bundle holds the keyframes within this travelled distance before and after [m].
    first_shift_m, last_shift_m, turn_rad
        Largest distance of the search in the first and in the second round [m], and largest rotation [rad].
        `last_shift_m` is also the largest distance of a bundle from its initial pose in the final registration.
    tightenings
        Number of further rounds without a search.
    min_gap_m
        Least travelled distance between two visits of a robot to a place [m].
    search_points, match_points
        Hits of a bundle that are used in the search, and in the registration.
    min_matched, max_violated, max_ambiguity, min_determined
        Thresholds of a closure: least share of matched hits, most hits in free space per matched hit, and largest score
        of another pose. A direction is undetermined if its curvature is a smaller share of the other direction's than
        `min_determined`; see `tbmslam.loop_closure.loop_closer`.
    sure_matched, doubtful_weight
        A closure between robots with a smaller share of matched hits has the weight `doubtful_weight`. Objects may have
        moved between the drives.
    min_closures
        Least number of closures. With fewer the alignment stays rigid.
    step_m, step_rad, crossing_m, crossing_rad
        Standard deviations of the motion from keyframe to keyframe, and between places where a drive crosses its path
        [m, rad], for drives without measured motions.
    stiffness_step_m, stiffness_reach_m
        Distance between such places along the drive, and largest distance between the two passages [m].
    closure_m, closure_rad
        Smallest standard deviations of a closure [m, rad].
    robust_width
        Number of standard deviations from which the weight of a closure decreases.
    adjustment
        The joint optimisation of poses and wall lines at the end.
    """

    PUBLIC: ClassVar = ("enabled",)

    enabled: bool = True
    submap: SubmapConfig = SubmapConfig()
    step: Metres = 1.0
    reach_m: Metres = 4.0
    submaps_per_step: Count = 2
    bundle_m: Annotated[float, Field(ge=0.0)] = 1.5
    first_shift_m: Metres = 0.8
    last_shift_m: Metres = 0.3
    tightenings: Annotated[int, Field(ge=0)] = 2
    min_gap_m: Metres = 12.0
    turn_rad: Annotated[float, Field(gt=0.0)] = 0.075
    search_points: Annotated[int, Field(ge=10)] = 150
    match_points: Annotated[int, Field(ge=10)] = 500
    min_matched: Share = 0.4
    sure_matched: Share = 0.58
    doubtful_weight: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1
    max_violated: Share = 0.2
    max_ambiguity: Share = 0.9
    min_determined: Annotated[float, Field(ge=0.0)] = 0.02
    min_closures: Count = 5
    step_m: Metres = 0.01
    step_rad: Annotated[float, Field(gt=0.0)] = 0.003
    crossing_m: Metres = 0.05
    crossing_rad: Annotated[float, Field(gt=0.0)] = 0.01
    stiffness_step_m: Metres = 2.0
    stiffness_reach_m: Metres = 3.0
    closure_m: Metres = 0.02
    closure_rad: Annotated[float, Field(gt=0.0)] = 0.004
    robust_width: Annotated[float, Field(gt=0.0)] = 2.0
    adjustment: AdjustmentConfig = AdjustmentConfig()
