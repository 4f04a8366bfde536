"""Alignment of two maps."""

from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.nonrigid.search import may_be_deformed, register_nonrigid
from merging.rigid_alignment import align_whole
from tbmslam.map.tbm_map import TbmMap


def align(target: TbmMap, source: TbmMap, config: MergeConfig | None = None) -> Alignment:
    """Estimate the pose of a source map in the frame of a target map, without an initial guess.

    The maps are aligned rigidly; if that is refused, one of them may be deformed. `merging.merge` also aligns maps with
    keyframes again by short ranges.

    Parameters
    ----------
    target, source
        The maps, as `tbmslam.load_map` or `tbmslam.Slam.finish` returns them; their cells may differ in size.
    config
        The parameters; None for the defaults.

    Returns
    -------
    The alignment; a refused one has a reason.

    Raises
    ------
    CellSizeError
        If the maps cannot be brought into cells of one size.
    """
    config = config or MergeConfig()
    found = align_whole(target, source, config)
    closer = register_nonrigid(target, source, config) if may_be_deformed(found, config) else None
    return found if closer is None else closer.alignment
