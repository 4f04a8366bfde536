"""Maps for the paper's experiments, made by this project's own programs, and the pairs whose true poses are known."""

import itertools
import logging
from collections.abc import Sequence
from pathlib import Path

from datasets.synthetic.map_pairs.pairs import building_of_area, cut_pairs
from merging.experiments.map_pair import MapPair
from merging.fusion import canvas_over, offset_in, window_over
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.errors import TbmSlamError
from tbmslam.io.map_folder import load_map
from tools import build_maps, make_world
from tools.evaluation import NAME as TRUTH_FILE
from tools.evaluation import read_truth_file
from tools.map_pairs import KnownPair

logger = logging.getLogger(__name__)

_FLOOR_SHARES = (0.6, 0.5, 0.4, 0.3, 0.2)
"""Of the canvas that two maps turned against each other need, what the floor itself may take; the first that fits."""


class PaperMapsError(TbmSlamError):
    """There are no maps that the experiments could use."""


def simulate_recordings(folder: Path, words: Sequence[str], drives: int, seed: int) -> list[Path]:
    """Let a robot drive several times through one building, and return the bags.

    Parameters
    ----------
    folder
        The folder of the bags, with one folder for each drive.
    words
        More options of make_world, the building among them.
    drives
        How many.
    seed
        Of the building; drives have this one and the following.

    Raises
    ------
    PaperMapsError
        If they cannot be simulated; make_world printed the reason.
    """
    bags = []
    for drive in range(drives):
        out = folder / f"drive_{drive}"
        code = make_world.main(["--seed", str(seed), "--drive-seed", str(seed + drive), "--out", str(out), *words])
        if code:
            raise PaperMapsError("the building could not be simulated: see the message above")
        bags.append(out / "robot_0.bag")
    return bags


def map_recordings(recordings: Sequence[Path], folder: Path, words: Sequence[str]) -> Path:
    """Map recordings by build_maps with more of its options, and return the folder with the maps and their truth.

    Raises
    ------
    PaperMapsError
        If they cannot be mapped; build_maps printed the reason.
    """
    code = build_maps.main([*map(str, recordings), "-o", str(folder), *words])
    if code:
        raise PaperMapsError("the recordings could not be mapped: see the message above")
    return folder


def map_simulated(bags: Sequence[Path], folder: Path, words: Sequence[str]) -> Path:
    """Map simulated drives, each on its own, with the truth beside the bags as reference."""
    truths = [str(bag.with_suffix(".truth.tum")) for bag in bags]
    return map_recordings(bags, folder, ["--separate", "--reference", *truths, *words])


def load_pairs(folder: Path, most: int, min_overlap: float) -> list[MapPair]:
    """Return the pairs of the maps that build_maps wrote into a folder, with their true poses.

    Parameters
    ----------
    folder
        With a folder for each map and truth.json.
    most
        Largest number of pairs.
    min_overlap
        Share of the smaller map that both must know.

    Raises
    ------
    TruthFileError
        If the poses of the maps are unknown.
    PaperMapsError
        If there is no pair.
    """
    truth = read_truth_file(folder / TRUTH_FILE)
    if (doubt := truth.doubt()) is not None:
        logger.warning("%s %s", folder / TRUTH_FILE, doubt)
    poses = truth.poses
    grids: dict[str, TbmGrid] = {name: load_map(folder / name).grid for name in poses}
    pairs: list[MapPair] = []
    for target, source in itertools.combinations(poses, 2):
        pair = MapPair(target, source, grids[target], grids[source], poses[target].inverse() @ poses[source])
        if len(pairs) < most and pair.overlap() >= min_overlap:
            pairs.append(pair)
    if not pairs:
        raise PaperMapsError(f"{folder}: no two of {len(poses)} maps share {min_overlap:.0%} of the smaller one")
    return pairs


def pair_of_area(area_m2: float, resolution: float) -> MapPair:
    """Return a pair cut from a building such that the merged map's rectangle has this area, within half a row.

    The target has rows of unknown cells where the maps themselves need less.
    """
    for share in _FLOOR_SHARES:
        known = KnownPair.of(next(cut_pairs(building_of_area(share * area_m2, 1, resolution), 1, [0.5])))
        target, source, motion = known.target.grid, known.source.grid, known.T_target_source
        assert motion is not None  # noqa: S101 - cut pairs overlap
        canvas = canvas_over([target.geometry, window_over(source.geometry, motion, target.geometry)])
        rows = round(area_m2 / (canvas.cols * resolution**2))
        if rows >= canvas.rows:
            return MapPair("a", "b", _on_canvas(target, canvas._replace(rows=rows)), source, motion)
    raise PaperMapsError(f"two maps of a floor do not fit into {area_m2:g} m² with cells of {resolution:g} m")


def _on_canvas(grid: TbmGrid, canvas: GridGeometry) -> TbmGrid:
    """Return a grid with unknown cells around it."""
    larger, (row, col) = TbmGrid.unknown(canvas), offset_in(canvas, grid.geometry)
    larger.masses[row : row + grid.geometry.rows, col : col + grid.geometry.cols] = grid.masses
    return larger
