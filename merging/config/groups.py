"""Every number of joining maps to groups, and of optimising the drives of a group together."""

from typing import Annotated, ClassVar

from pydantic import Field

from tbmslam.frozen_config import Count, FrozenConfig, Metres, Share
from tbmslam.loop_closure.submap import SubmapConfig
from tbmslam.optimisation.config import AdjustmentConfig


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
        worth, see `merging.map_graph.hypothesis.support_of`. Of 10,000 threes of maps, two of them of one place, the
        third laid onto one of these wrongly, it lay alike on the other in 30 %, and in 47 % where its
        confidence was above 0.1.
    min_support
        Least log odds at which maps are joined.
    sure_alone, min_whole
        An accepted alignment with less confidence than the first that alone joins two groups is refused if these, each
        as one map, give its place less than the second; see `merging.bridges`.
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


class RetrievalConfig(FrozenConfig):
    """Which pairs of many maps are aligned.

    Parameters
    ----------
    few
        Up to so many maps all pairs are aligned. Where 24 maps of three real drives were aligned in rounds, one of them
        was not joined: the pairs that join it share little, and do not look alike.
    neighbours
        In each round a map is aligned with so many others that look most like it. With 3, 7 and 12 all 30 maps are
        joined that three real drives were cut into; with 3 and 7 two of them are not.
    """

    PUBLIC: ClassVar = ()

    few: Count = 30
    neighbours: tuple[Count, ...] = (3, 7, 15)


class JointConfig(FrozenConfig):
    """Joint optimisation of the drives of several robots.

    Parameters
    ----------
    enabled
        Whether it is tried where maps carry keyframes.
    submap
        How stretches of a drive become submaps.
    step
        Travelled length between keyframes that are laid onto other robots' submaps [m].
    reach_m, submaps_per_step
        How near a keyframe must be to a submap's way [m], and how many of the nearest are tried.
    bundle_m
        Keyframes within this length before and after join a bundle [m].
    first_shift_m, last_shift_m, turn_rad
        How far a bundle is searched from where it is expected, in the first round and in the second [m], and how far
        turned [rad]. The second is also how far it may slide when it is laid onto the surfaces.
    tightenings
        Further rounds, in which bundles are laid onto the surfaces from where they are, without a search.
    min_gap_m
        Travelled length between two visits of a robot to a place [m].
    search_points, match_points
        Hits of a bundle used in a search, and in the fit.
    min_matched, max_violated, max_ambiguity, min_determined
        A closure has so much of its bundle on surfaces, at the most so many hits in free space for one on surfaces, and
        no place as good elsewhere; a direction whose curvature is a smaller share of the other's than the last is left
        open; see `tbmslam.loop_closure.loop_closer`.
    sure_matched, doubtful_weight
        With less of its bundle on surfaces than it takes to close a loop of one robot, a closure between robots counts
        for a share only: things were moved, or the fit is none.
    min_closures
        With fewer the alignment stays rigid.
    step_m, step_rad, crossing_m, crossing_rad
        Standard deviations of the motion from keyframe to keyframe, and between places where a drive comes near its
        own way again [m, rad], for drives of which only the poses are known.
    stiffness_step_m, stiffness_reach_m
        How often the latter are taken, and how near is near [m].
    closure_m, closure_rad
        Accuracy of a closure at best [m, rad].
    robust_width
        Deviations at which a closure begins to lose its say.
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
