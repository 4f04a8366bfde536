"""Methods of the related work that align two maps: a module for each method, named after its authors.

They are compared under equal conditions: the same pairs, processor and interface, `align(target, source, config)`. No
authors published their code. Each module separates the authors' idea from choices of this project.
"""

from collections.abc import Callable

from merging.alignment import Alignment
from merging.baselines import birk_carpin, carpin, dobrokhvalov_filatov, li, saeedi, trehard
from merging.config import MergeConfig, Method
from merging.fusion import at_resolution
from tbmslam.belief.grid import TbmGrid

BASELINES: dict[Method, Callable[[TbmGrid, TbmGrid, MergeConfig], Alignment]] = {
    "birk-carpin": birk_carpin.align,
    "carpin": carpin.align,
    "li": li.align,
    "saeedi": saeedi.align,
    "trehard": trehard.align,
    "dobrokhvalov-filatov": dobrokhvalov_filatov.align,
}
"""Methods that need only two maps; Howard's also needs encounters."""


def align_baseline(target: TbmGrid, source: TbmGrid, resolution: float, config: MergeConfig) -> Alignment:
    """Estimate the pose of a source grid in the target's frame by the configured method of the related work.

    The maps are compared at a resolution [m]. Accepted alignments have confidence 0, since these methods give no
    probability.
    """
    if config.method not in BASELINES:
        raise ValueError(f"method must be one of {', '.join(BASELINES)}, got {config.method!r}")
    for name, grid in (("target", target), ("source", source)):
        if not grid.is_known().any():
            return Alignment(config.method, accepted=False, reason=f"the {name} map is empty: no cell of it was seen")
    return BASELINES[config.method](at_resolution(target, resolution), at_resolution(source, resolution), config)
