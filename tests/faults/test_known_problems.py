"""Problems with maps and merging that users of other programs reported.

Problems with recordings are in tests/datasets, and those of whole programs in tests/tools.
"""

import math
import os
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata

import numpy as np
import pytest

from datasets.synthetic.map_pairs.pairs import building_of_world
from merging.config import MergeConfig
from merging.fusion import fuse
from merging.merger import merge
from tbmslam.belief.evidence_grid import EvidenceGrid, GridTooLargeError
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.evaluation.trajectory_errors import TrajectoryAlignmentError, absolute_errors
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.io.map_folder import load_map, save_map
from tbmslam.io.ros_map import read_ros_map, write_ros_map
from tbmslam.io.trajectory_file import TumError, read_tum, write_tum
from tbmslam.kernels.rays.insertion import __dict__ as insertion_kernels
from tbmslam.map.drive import Drive
from tbmslam.map.map_check import MapFileError, check_size
from tbmslam.map.tbm_map import TbmMap
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tbmslam.slam import Slam
from tests.processes import python
from tools.map_pairs.floors import pairs_of
from tools.map_pairs.known_pair import grid_of

YAML = (
    "image: {image}\nresolution: {resolution}\norigin: {origin}\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)
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


def ros_map(tmp_path, image=b"P5\n4 3\n255\n" + bytes(12), **values):
    (tmp_path / "m.pgm").write_bytes(image)
    text = YAML.format(**{"image": "m.pgm", "resolution": 0.05, "origin": "[0, 0, 0]", **values})
    (tmp_path / "m.yaml").write_text(text)
    return tmp_path / "m.yaml"


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


@pytest.mark.parametrize(
    "image",
    [
        b"P5\n4 3\n255\n" + bytes(5),
        b"P5\n60000 60000\n255\n" + bytes(12),
        b"P5\n4294967297 4294967296\n255\n" + bytes(12),
        b"P5\n-4 3\n255\n" + bytes(12),
    ],
)
def test_an_image_that_is_not_as_large_as_it_says(tmp_path, image):
    with pytest.raises(MapFileError, match=r"m\.(pgm|yaml): "):
        read_ros_map(ros_map(tmp_path, image))


@pytest.mark.parametrize("resolution", [0, -1, ".nan", ".inf", "-.inf", "wide"])
def test_a_resolution_that_is_none(tmp_path, resolution):
    with pytest.raises(MapFileError, match=r"m\.yaml: .*resolution"):
        read_ros_map(ros_map(tmp_path, resolution=resolution))


def test_a_map_too_large_is_refused_before_memory_is_taken():
    tracemalloc.start()
    with pytest.raises(MapFileError, match="60000 x 60000 cells are more than"):
        check_size("m.yaml", 60000, 60000)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


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


def test_a_grid_too_large_ends_with_what_to_change():
    with pytest.raises(GridTooLargeError, match=r"raise map\.max_cells, use a coarser map\.resolution"):
        EvidenceGrid(0.05, max_cells=1000).grow_to_contain(np.array([[0.0, 0.0], [1e4, 1e4]]))


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


def test_a_yaw_that_is_no_number_and_an_origin_with_all_its_digits(tmp_path):
    with pytest.raises(MapFileError, match=r"m\.yaml: .*origin"):
        read_ros_map(ros_map(tmp_path, origin="[0, 0, .nan]"))
    grid = checkered(20, 30, origin=(-1234.56789, 98.7654321))
    write_ros_map(tmp_path / "map", grid)
    geometry = read_ros_map(tmp_path / "map.yaml").geometry
    assert (geometry.origin_x, geometry.origin_y) == pytest.approx((-1234.56789, 98.7654321), abs=1e-9)


def test_the_unknown_stays_unknown(tmp_path, caplog):
    write_ros_map(tmp_path / "map", checkered(20, 30))
    again = read_ros_map(tmp_path / "map.yaml")
    assert not again.is_known()[-2:].any()
    assert again.is_known()[:-2].all()
    yaml = (tmp_path / "map.yaml").read_text()
    assert "free_thresh: 0.19" in yaml
    (tmp_path / "map.yaml").write_text(yaml.replace("0.196", "0.25"))  # as nav2's saver wrote it
    of_nav2 = read_ros_map(tmp_path / "map.yaml")
    np.testing.assert_array_equal(of_nav2.masses, again.masses)
    assert (
        "with free_thresh 0.25 the unknown pixels (205) of its map saver would be free: they are read as unknown"
        in caplog.text
    )


@pytest.mark.parametrize("size", [(1, 1), (1, 17), (13, 7)])
@pytest.mark.parametrize("pose", [SE2(0.0, 0.0, 0.3), SE2(-7.77, 3.3, -3.1)])
def test_odd_sizes_and_transforms(size, pose):
    grid = checkered(*size)
    moved = resample(grid, pose, GridGeometry(0.05, -10.0, -10.0, 401, 399))
    assert np.allclose(moved.masses.sum(axis=-1), 1.0)


def test_nothing_merged_is_no_success():
    blank = TbmMap(TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 60, 60)))
    result = merge({"a": blank, "b": TbmMap(checkered(60, 60))}, MergeConfig())
    assert result.merged is None
    assert all(reason for reason in result.left_out.values())


def test_a_moved_map_lies_where_it_should():
    grid = TbmGrid.unknown(GridGeometry(0.05, -3.0, 2.0, 40, 60))
    row, col = 11, 37
    grid.masses[row, col] = np.eye(4)[OCCUPIED]
    pose = SE2(100.0, -50.0, math.pi / 2.0)
    geometry = GridGeometry(0.05, 90.0, -60.0, 400, 400)
    moved = resample(grid, pose, geometry)
    x, y = pose.apply(np.array([grid.geometry.centre_of(row, col)]))[0]
    assert moved.masses[geometry.cell_at(float(x), float(y))][OCCUPIED] == pytest.approx(1.0)


def test_maps_of_different_sizes_fuse():
    windows = [checkered(40, 60), checkered(90, 30, origin=(1.0, 0.5))]
    fused = fuse(windows)
    min_x, min_y, max_x, max_y = fused.grid.geometry.bounds()
    assert (max_x - min_x, max_y - min_y) == pytest.approx((3.0, 5.0))


def test_a_map_merged_again_and_again_does_not_grow():
    pair = next(iter(pairs_of([building_of_world("apartment", 3)], 1, [0.75])))
    first, second = (TbmMap(grid_of(seen, pair.resolution)) for seen in (pair.occ_a, pair.occ_b))
    merged = merge({"first": first, "second": second}, MergeConfig()).merged
    assert merged is not None
    size = merged.grid.geometry
    for _ in range(3):
        merged = merge({"merged": merged, "again": first}, MergeConfig()).merged
        assert merged is not None
        assert merged.grid.geometry.rows <= size.rows + 1
        assert merged.grid.geometry.cols <= size.cols + 1


def test_a_transform_is_applied_once():
    keyframes = slam_of(drive_of_room()).drives[0].keyframes
    poses = np.tile([1.0, 2.0, 0.3], (keyframes.indices[-1] + 1, 1))
    trajectory = Trajectory(np.arange(float(len(poses))), poses)
    tbm_map = TbmMap(checkered(5, 5), (Drive("a", trajectory, keyframes),))
    pose = SE2(10.0, 0.0, math.pi / 2.0)
    moved = tbm_map.moved(pose, tbm_map.grid).drives[0]
    assert moved.trajectory.poses[0] == pytest.approx([8.0, 1.0, 0.3 + math.pi / 2.0])
    assert moved.keyframes.pose(0) == pytest.approx(pose @ keyframes.pose(0))


def test_trajectories_as_others_read_them(tmp_path):
    stamps = 1.3e9 + np.array([0.0, 1e-5, 2e-5])
    write_tum(tmp_path / "t.tum", Trajectory(stamps, np.array([[1.0, 2.0, 3.0]] * 3)))
    for line in (tmp_path / "t.tum").read_text().splitlines():
        assert line == line.strip()
        assert len(line.split(" ")) == 8
    again = read_tum(tmp_path / "t.tum")
    assert np.diff(again.stamps) == pytest.approx([1e-5, 1e-5], abs=3e-7)
    (tmp_path / "empty.tum").write_text("")
    with pytest.raises(TumError, match=r"empty\.tum"):
        read_tum(tmp_path / "empty.tum")
    later = Trajectory(stamps + 82.2, again.poses)
    with pytest.raises(TrajectoryAlignmentError, match=r"stamps|clock"):
        absolute_errors(again, later, 0.01)


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


def test_a_shift_moves_masses_exactly_and_the_library_of_one_bad_release_is_out():
    grid = checkered(30, 40)
    moved = resample(grid, SE2(0.35, -0.2, 0.0), GridGeometry(0.05, 0.35, -0.2, 30, 40))
    np.testing.assert_array_equal(moved.masses, grid.masses)
    assert tuple(int(part) for part in metadata.version("opencv-python-headless").split(".")[:2]) >= (4, 14)


def test_the_same_scans_give_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        save_map(tmp_path / name, slam_of(drive_of_room()))
    assert (tmp_path / "a" / "map.npz").read_bytes() == (tmp_path / "b" / "map.npz").read_bytes()


def test_no_pickle_is_opened(tmp_path):
    save_map(tmp_path, slam_of(drive_of_room()))
    with np.load(tmp_path / "map.npz") as arrays:
        values = dict(arrays)
    values["masses"] = np.array([print], dtype=object)
    np.savez(tmp_path / "map.npz", **values, allow_pickle=True)
    with pytest.raises(MapFileError, match=r"map\.npz"):
        load_map(tmp_path / "map.npz")


@pytest.mark.parametrize("shift", [40, 90])
def test_a_self_similar_corridor_is_refused(shift):
    corridor = np.zeros((44, 400, 4), dtype=np.float32)
    corridor[..., FREE] = 1.0
    corridor[:2] = corridor[-2:] = np.eye(4, dtype=np.float32)[OCCUPIED]
    parts = [corridor[:, :260], corridor[:, shift : shift + 260]]
    maps = {
        name: TbmMap(TbmGrid(GridGeometry(0.05, 0.0, 0.0, *part.shape[:2]), np.ascontiguousarray(part)))
        for name, part in zip("ab", parts, strict=True)
    }
    assert merge(maps, MergeConfig()).merged is None
