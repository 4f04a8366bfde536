"""How well a map lies on another where it certainly does not belong: its mirror image, laid onto it all the same.

A mirror image has the same walls, rooms and repetitions, and is found nowhere in a building but by chance or because
the building is symmetrical. A place that is the true one fits better than the best place of the mirror image; one that
chance found does not. It is the target-decoy search of J. Elias and S. Gygi, Nature Methods 4, 2007.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from merging.config import MergeConfig
from merging.registration.hypotheses import find_candidates
from merging.scoring.confidence import confidences
from merging.verification.evidence import Evidence
from merging.walls.wall_map import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid

Cell = TypeVar("Cell", bound=np.generic)


def find_decoys(target: WallMap, source: WallMap, config: MergeConfig, *, thoroughly: bool = True) -> list[Evidence]:
    """Return what the maps say for and against the best places of the source's mirror image in the target.

    `thoroughly` searches them as the source itself is searched, which tells chance without favour; less finds in a
    quarter of the time what may be less than chance achieves.
    """
    search = config.correlation if thoroughly else config.decoys
    found = find_candidates(target, mirror_image(source), config.model_copy(update={"correlation": search}))
    return [evidence for _, evidence in found]


def mirror_image(structure: WallMap) -> WallMap:
    """Return a map as a mirror along its y axis shows it."""
    g = structure.geometry
    return replace(
        structure,
        geometry=GridGeometry(g.resolution, -(g.origin_x + g.cols * g.resolution), g.origin_y, g.rows, g.cols),
        points=structure.points * (-1.0, 1.0),
        normals=structure.normals * (-1.0, 1.0),
        known=_flipped(structure.known),
        free=_flipped(structure.free),
        distances_m=_flipped(structure.distances_m),
        nearest=_flipped(structure.nearest),
    )


def mirrored(grid: TbmGrid) -> TbmGrid:
    """Return a grid as a mirror along its y axis shows it."""
    g = grid.geometry
    return TbmGrid(g._replace(origin_x=-(g.origin_x + g.cols * g.resolution)), _flipped(grid.masses))


def _flipped(cells: npt.NDArray[Cell]) -> npt.NDArray[Cell]:
    return np.ascontiguousarray(cells[:, ::-1])


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
