"""The grid of a map, drawn from the keyframes of its drives."""

from collections.abc import Sequence

import numpy as np

from tbmslam.config import MapConfig
from tbmslam.evidence_grid import EvidenceGrid, check_size
from tbmslam.grid import GridGeometry, TbmGrid
from tbmslam.kernels.counting import Counts, beam_ends, count_masses, count_scans
from tbmslam.kernels.lattice import Lattice
from tbmslam.keyframes import Keyframes
from tbmslam.mapping import ScanInserter
from tbmslam.se2 import FloatArray
from tbmslam.sensor_model import beam_factors


def render(drives: Sequence[Keyframes], config: MapConfig) -> TbmGrid:
    """Return the smallest grid that holds all that the keyframes saw.

    Raises
    ------
    GridTooLargeError
        When it would have more than `max_cells` cells.
    """
    counted = config.insertion.once_per_scan
    return _from_counts(drives, config) if counted else _from_beams(drives, config)


def _from_beams(drives: Sequence[Keyframes], config: MapConfig) -> TbmGrid:
    """Insert scan by scan, every beam having its own word."""
    grid = EvidenceGrid(config.resolution, config.max_cells)
    inserter = ScanInserter(config.sensor_model, config.insertion)
    for keyframes in drives:
        for index in range(len(keyframes)):
            inserter.insert(keyframes.scan(index), keyframes.sensor_pose(index), grid)
    return grid.to_tbm_grid(config.keep_conflict).cropped_to_known()


def _from_counts(drives: Sequence[Keyframes], config: MapConfig) -> TbmGrid:
    """Count the scans that speak of each cell: where each has one word, the counts are all that matters."""
    limit, clears = config.insertion.max_range, config.insertion.no_return == "free"
    lasers = [keyframes.all_sensor_poses() for keyframes in drives]
    seen = [
        beam_ends(k.ranges, k.offsets, k.beams, k.beam_steps, poses, limit, clears)
        for k, poses in zip(drives, lasers, strict=True)
    ]
    touched = [ends for ends, _, _ in seen if len(ends)]
    touched += [poses[np.diff(o) > 0, :2] for poses, (_, _, o) in zip(lasers, seen, strict=True)]
    if not any(map(len, touched)):
        return EvidenceGrid(config.resolution).to_tbm_grid()
    geometry = _geometry_around(touched, config)
    first_row, first_col = round(geometry.origin_y / config.resolution), round(geometry.origin_x / config.resolution)
    counts: Counts = np.zeros((3, geometry.rows + 2, geometry.cols + 2), dtype=np.int32)
    for poses, (ends, is_hit, offsets) in zip(lasers, seen, strict=True):
        counts[0] = 0
        count_scans(counts, Lattice(config.resolution, first_row - 1, first_col - 1), poses, ends, is_hit, offsets)
    return TbmGrid(geometry, _masses(counts[:, 1:-1, 1:-1], config))


def _geometry_around(points: Sequence[FloatArray], config: MapConfig) -> GridGeometry:
    """Return the cells that hold all points (N, 2)."""
    low = np.min([p.min(axis=0) for p in points if len(p)], axis=0)
    high = np.max([p.max(axis=0) for p in points if len(p)], axis=0)
    (left, bottom), (right, top) = (np.floor(corner / config.resolution).astype(int) for corner in (low, high))
    rows, cols = int(top - bottom + 1), int(right - left + 1)
    check_size(rows, cols, config.resolution, config.max_cells)
    return GridGeometry(
        config.resolution, float(left) * config.resolution, float(bottom) * config.resolution, rows, cols
    )


def _masses(counts: Counts, config: MapConfig) -> np.ndarray[tuple[int, int, int], np.dtype[np.float32]]:
    factors = beam_factors(config.sensor_model, config.resolution, 1.0)
    hit, miss = (
        # Evidence beyond this floor is certain; the masses' quotients must not become 0 / 0.
        np.maximum(one[None, :] ** -np.arange(most + 1.0)[:, None], 1e-150)
        for one, most in ((factors.hit, counts[1].max()), (factors.miss, counts[2].max()))
    )
    return count_masses(counts, hit, miss, config.keep_conflict)
