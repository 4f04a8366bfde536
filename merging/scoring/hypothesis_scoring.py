"""How likely each place of a source map is the truth, beside what chance achieves in the same two maps."""

from collections.abc import Sequence

from merging.config import MergeConfig
from merging.scoring.confidence import confidences
from merging.scoring.decoys import find_decoys
from merging.verification.evidence import Evidence
from merging.walls.wall_map import WallMap

_IN_DOUBT = (0.1, 0.999)
"""Within these a closer look at chance may decide. It hardly ever makes a place likelier."""


def score_hypotheses(
    target: WallMap, source: WallMap, places: Sequence[Evidence], config: MergeConfig
) -> tuple[list[float], list[Evidence]]:
    """Return the probability (K,) of each place, together 1 at the most, and what chance achieves.

    A glance at chance settles most pairs. Where it does not, chance is searched as thoroughly as the places were, since
    the best of many is better than the best of few.

    Parameters
    ----------
    target, source
        The maps.
    places
        What they say for and against each place (K,) of the source.
    config
        How chance is searched.
    """
    decoys = find_decoys(target, source, config, thoroughly=False)
    likely = confidences(places, decoys)
    if _IN_DOUBT[0] <= max(likely, default=0.0) < _IN_DOUBT[1]:
        decoys = find_decoys(target, source, config)
        likely = confidences(places, decoys)
    return likely, decoys
