"""A map bent so that it fits another: from where it is thought to lie its tiles slide, large ones first.

Two robots, or one in two years, hardly ever bend a building alike: rooms apart lie some tenths of a metre from where
the other map has them, more than walls that agree may lie apart. No rigid motion brings all of them together.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from merging.config import MergeConfig
from merging.nonrigid.deformation import Deformation
from merging.nonrigid.tiles import middle_of, tiles_of
from merging.registration.hypotheses import refine_all
from merging.verification.evidence import examine
from merging.walls.wall_map import WallMap
from tbmslam.belief.grid import TbmGrid
from tbmslam.geometry.se2 import SE2


@dataclass(frozen=True)
class DeformableMap:
    """A map that may be bent.

    Parameters
    ----------
    grid
        Its cells.
    structure
        Their walls and free space.
    rounds
        The tiles that slide, round after round.
    """

    grid: TbmGrid
    structure: WallMap
    rounds: Sequence[Sequence[WallMap]]

    @classmethod
    def of(cls, grid: TbmGrid, config: MergeConfig, structure: WallMap | None = None) -> "DeformableMap":
        """Cut a grid into tiles; its structure is found where it is not given."""
        how = config.nonrigid
        large = tiles_of(grid, how.side_m, how.most, config.structure)
        small = tiles_of(grid, how.side_m / 2.0, 4 * how.most, config.structure)
        rounds = (large, small, small) if len(large) > 1 else (small, small)
        return cls(grid, structure or WallMap.from_grid(grid, config.structure), rounds)


@dataclass(frozen=True)
class DeformedMap:
    """A map that was bent.

    Parameters
    ----------
    bend
        Where its points belong.
    motion
        The rigid T_target_source nearest to that, which lays the bent map there.
    apart_m, apart_rad
        How far its tiles lie from where that alone would lay them, root mean squares [m], [rad].
    grid
        The bent map, in its own frame.
    """

    bend: Deformation
    motion: SE2
    apart_m: float
    apart_rad: float
    grid: TbmGrid


def deform(target: WallMap, source: DeformableMap, start: SE2, config: MergeConfig) -> DeformedMap | None:
    """Deform a map so that it fits another near where it is thought to lie; None where hardly any of it fits.

    Parameters
    ----------
    target
        The other map.
    source
        The map.
    start
        T_target_source, roughly.
    config
        How tiles slide.
    """
    bend = Deformation.none(start)
    for tiles in source.rounds:
        laid = _slid(target, tiles, bend, config)
        if len(laid) < 2:
            return None
        bend = Deformation.of([tile for tile, _ in laid], [motion for _, motion in laid])
    motion, apart_m, apart_rad = bend.rigid()
    return DeformedMap(bend, motion, apart_m, apart_rad, bend.straightened(source.grid, motion))


def _slid(
    target: WallMap, tiles: Sequence[WallMap], bend: Deformation, config: MergeConfig
) -> list[tuple[WallMap, SE2]]:
    """Let tiles slide from where a bent map has them; return those that fit near there, and where."""
    how, laid = config.nonrigid, list[tuple[WallMap, SE2]]()
    for tile in tiles:
        middle = middle_of(tile)
        start = bend.motion_at(middle)
        motion = refine_all(target, tile, [start], config)[0]
        found = examine(target, tile, motion, config.verification)
        fits = found.agreement >= how.min_agreement and found.agreed_wall_m >= how.min_wall_m
        if fits and math.dist(motion.apply(middle), start.apply(middle)) <= how.farthest_m:
            laid.append((tile, motion))
    return laid
