"""Problems with maps and merging that users of other programs reported; those of whole programs are in tests/tools."""

import math
import os
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from datasets.synthetic.map_pairs.pairs import building_of_world
from merging.config import MergeConfig
from merging.merger import merge
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.geometry.se2 import SE2
from tbmslam.io.map_folder import load_map, save_map
from tbmslam.io.ros_map import read_ros_map, write_ros_map
from tbmslam.kernels.rays.insertion import __dict__ as insertion_kernels
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.slam import Slam
from tests.processes import python
from tools.map_pairs.floors import pairs_of

ANGLES = np.linspace(-math.pi, math.pi, 180, endpoint=False)


def room_scan(stamp, ranges=None, x=0.0):
    """Return what a laser sees of a room of 8 m by 5 m, at x off its middle."""
    with np.errstate(divide="ignore"):
        across = np.where(np.cos(ANGLES) > 0, 4.0 - x, 4.0 + x) / np.abs(np.cos(ANGLES))
        along = 2.5 / np.abs(np.sin(ANGLES))
    seen = np.minimum(across, along) if ranges is None else np.asarray(ranges, dtype=np.float64)
    step = 2.0 * math.pi / 180
    return LaserScan(stamp, -math.pi, step, 0.1, 30.0, seen)


def slam_of(scans):
    slam = Slam()
    for number, scan in enumerate(scans):
        slam.process(Reading(scan, SE2(0.1 * number, 0.0, 0.0)))
    return slam.finish()


def drive_of_room(number=12):
    return [room_scan(0.1 * k, x=0.1 * k) for k in range(number)]


def checkered(rows, cols, resolution=0.05, origin=(0.0, 0.0)):
    masses = np.zeros((rows, cols, 4), dtype=np.float32)
    masses[..., FREE] = 1.0
    masses[::7, ::5] = np.eye(4, dtype=np.float32)[OCCUPIED]
    masses[-2:] = np.eye(4, dtype=np.float32)[UNKNOWN]
    return TbmGrid(GridGeometry(resolution, *origin, rows, cols), masses)


def test_beam_counts_that_vary_are_mapped():
    scans = [room_scan(0.1 * k) for k in range(6)]
    scans[2] = LaserScan(0.2, scans[2].angle_min, scans[2].angle_increment, 0.1, 30.0, scans[2].ranges[:-1])
    tbm_map = slam_of(scans)
    assert len(tbm_map.drives[0].trajectory) == 6


@pytest.mark.parametrize(("report", "value"), [("d03", np.inf), ("d04", np.nan)])
def test_ranges_without_a_number_poison_nothing(report, value):
    scans = drive_of_room()
    scans[3].ranges[:40] = value
    scans[4].ranges[:] = value
    tbm_map = slam_of(scans)
    assert np.isfinite(tbm_map.grid.masses).all()
    assert tbm_map.grid.is_known().sum() * 0.05**2 == pytest.approx(40.0, rel=0.15)


def test_stamps_that_step_back_or_repeat_are_mapped():
    scans = [room_scan(stamp, x=0.1 * k) for k, stamp in enumerate((0.0, 0.1, 0.1, 0.05, -1e9, 0.3))]
    trajectory = slam_of(scans).drives[0].trajectory
    assert np.abs(trajectory.poses[:, 0] - 0.1 * np.arange(6)).max() < 0.05


@pytest.mark.parametrize("first", [[np.nan] * 180, [np.inf] * 180, [0.2] * 180])
def test_a_bad_first_scan_does_not_leave_the_map_empty(first):
    tbm_map = slam_of([room_scan(-0.1, first), *drive_of_room()])
    assert tbm_map.grid.is_known().sum() * 0.05**2 == pytest.approx(40.0, rel=0.2)


def test_nothing_in_range_writes_no_wall():
    tbm_map = slam_of([room_scan(0.1 * k, np.where(ANGLES > 0.0, np.inf, 3.0)) for k in range(5)])
    occupied = np.argwhere(tbm_map.grid.pignistic() > 0.6)
    ys = [tbm_map.grid.geometry.centre_of(int(row), int(col))[1] for row, col in occupied]
    assert max(ys) < 0.3


def peak_bytes(work):
    work()  # what is loaded and compiled is not its own
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_a_large_map_takes_no_more_memory_than_is_asked_for_before_it_is_read_or_written(tmp_path):
    grid = checkered(700, 900)
    most = 20 * grid.geometry.rows * grid.geometry.cols + 4_000_000  # what does not grow with the cells
    tbm_map = TbmMap(grid)
    assert peak_bytes(lambda: save_map(tmp_path, tbm_map)) < most
    assert peak_bytes(lambda: load_map(tmp_path / "map.npz")) < most
    assert peak_bytes(lambda: load_map(tmp_path / "map.yaml")) < most


def test_loading_again_and_again_takes_no_more_memory(tmp_path):
    save_map(tmp_path, slam_of(drive_of_room()))
    load_map(tmp_path)
    tracemalloc.start()
    for _ in range(3):
        loaded = load_map(tmp_path)
    once = tracemalloc.get_traced_memory()[0]
    for _ in range(5):
        loaded = load_map(tmp_path)
    assert tracemalloc.get_traced_memory()[0] < once + loaded.grid.masses.nbytes // 2 + 100_000
    tracemalloc.stop()


def test_an_origin_keeps_its_digits(tmp_path):
    grid = checkered(20, 30, origin=(-1234.56789, 98.7654321))
    write_ros_map(tmp_path / "map.yaml", grid)
    geometry = read_ros_map(tmp_path / "map.yaml").geometry
    assert (geometry.origin_x, geometry.origin_y) == pytest.approx((-1234.56789, 98.7654321), abs=1e-9)


def test_a_map_merged_again_and_again_does_not_grow():
    pair = next(iter(pairs_of([building_of_world("apartment", 3)], 1, [0.75])))
    first, second = (TbmMap.from_occupancy(seen, pair.resolution) for seen in (pair.occ_a, pair.occ_b))
    merged = merge({"first": first, "second": second}, MergeConfig()).merged
    assert merged is not None
    size = merged.grid.geometry
    for _ in range(3):
        merged = merge({"merged": merged, "again": first}, MergeConfig()).merged
        assert merged is not None
        assert merged.grid.geometry.rows <= size.rows + 1
        assert merged.grid.geometry.cols <= size.cols + 1


def test_kernels_are_exact_and_know_nan():
    kernels = [value for value in insertion_kernels.values() if hasattr(value, "targetoptions")]
    assert kernels
    for each in kernels:
        assert not each.targetoptions.get("fastmath")
        assert not each.targetoptions.get("parallel")


@pytest.mark.parametrize("place", ["/dev/null/cache", "~nobody-of-this-name/cache"])
def test_kernels_work_without_a_cache_folder(place):
    code = (
        "from tbmslam.kernels import kernel; from tbmslam.kernels.cache_folders import cache_root; "
        "print(cache_root(), kernel(lambda x: x + 1)(1))"
    )
    done = python("-c", code, environment={"PATH": os.defpath}, NUMBA_CACHE_DIR=place)
    assert (done.stdout, done.returncode) == ("None 2\n", 0), done.stderr


def test_two_threads_map_at_once():
    alone = slam_of(drive_of_room())
    with ThreadPoolExecutor(2) as pool:
        made = list(pool.map(lambda _: slam_of(drive_of_room()), range(4)))
    assert {each.grid.masses.tobytes() for each in made} == {alone.grid.masses.tobytes()}
