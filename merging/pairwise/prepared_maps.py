"""Maps as the aligner looks at them, each once for every cell size that its pairs are compared in."""

from collections.abc import Mapping

from merging.alignment import Pair
from merging.config import MergeConfig
from merging.fusion.warping import CellSizeError
from merging.rigid_alignment import PreparedMap, comparison_resolution, prepared
from tbmslam.belief.grid import TbmGrid


class PreparedMaps:
    """Looks at maps when they are first asked for.

    A coarse map costs only the pairs that it is in: the others are compared in their own, finer cells.

    Parameters
    ----------
    grids
        The maps' grids by name.
    config
        How they are looked at.
    """

    def __init__(self, grids: Mapping[str, TbmGrid], config: MergeConfig) -> None:
        self._grids, self._config = grids, config
        self._views: dict[tuple[str, float], PreparedMap | None] = {}

    def of_pair(self, pair: Pair) -> tuple[PreparedMap | None, PreparedMap | None]:
        """Return both maps of a pair, target and source, in cells of one size; None for one of which nothing is known.

        Raises
        ------
        CellSizeError
            If no map has cells of such a size, or one of the two is far too large for it.
        """
        target, source = pair
        resolution = comparison_resolution([self._grids[target], self._grids[source]], self._config)
        return self._view(target, resolution), self._view(source, resolution)

    def _view(self, name: str, resolution: float) -> PreparedMap | None:
        look = name, resolution
        if look not in self._views:
            self._views[look] = prepared_by_name(name, self._grids[name], resolution, self._config)
        return self._views[look]


def prepared_by_name(name: str, grid: TbmGrid, resolution: float, config: MergeConfig) -> PreparedMap | None:
    """Return a map as `merging.rigid_alignment.prepared` does; an error says which map it is.

    Raises
    ------
    CellSizeError
        If the map is far too large for cells of that size.
    """
    try:
        return prepared(grid, resolution, config)
    except CellSizeError as error:
        raise CellSizeError(f"{name}: {error}") from None
