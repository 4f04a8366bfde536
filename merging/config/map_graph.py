"""Every number of joining maps to groups."""

from typing import Annotated

from pydantic import Field

from tbmslam.frozen_config import FrozenConfig, Metres, Share


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
        worth, see `merging.map_graph.hypothesis.worth_of`. Of 10,000 threes of maps, two of them of one place, the
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
