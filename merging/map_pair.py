"""Two maps, and where one lies in the other's frame."""

from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.nonrigid.search import may_be_deformed, register_nonrigid
from merging.rigid_alignment import align_whole
from tbmslam.map.tbm_map import TbmMap


def align(target: TbmMap, source: TbmMap, config: MergeConfig | None = None) -> Alignment:
    """Find where a source map lies in a target map's frame, without any initial guess.

    The maps are laid onto each other as they are; where they fit nowhere so, they are looked at once more, one of them
    bent. `merging.merge` looks once more at maps that carry keyframes, too.

    Parameters
    ----------
    target, source
        The maps, as `tbmslam.load_map` or `tbmslam.Slam.finish` returns them; their cells may differ in size.
    config
        How; the defaults where None.

    Returns
    -------
    The alignment; where there is none that can be believed, a refusal that says why.

    Raises
    ------
    CellSizeError
        If the maps cannot be brought into cells of one size.
    """
    config = config or MergeConfig()
    found = align_whole(target, source, config)
    closer = register_nonrigid(target, source, config) if may_be_deformed(found, config) else None
    return found if closer is None else closer.alignment
