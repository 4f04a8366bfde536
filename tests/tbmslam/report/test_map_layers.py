import tracemalloc

import numpy as np
import pytest

from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import OCCUPIED
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tbmslam.map.drive import Drive
from tbmslam.map.keyframes import Keyframes
from tbmslam.report import map_layers
from tbmslam.report.map_layers import drive_layers, for_display, incident_layer
from tbmslam.sensing.laser_scan import LaserScan


def test_every_mass_is_a_picture_and_one_is_shown_at_a_time():
    masses = np.zeros((4, 5, 4), dtype=np.float32)
    masses[...] = (0.1, 0.2, 0.3, 0.4)
    layers = map_layers.map_layers(TbmGrid(GridGeometry(0.1, 0.0, 0.0, 4, 5), masses))
    assert [layer.switch.label for layer in layers] == ["pignistic", "occupied", "free", "unknown", "conflict"]
    assert all(layer.switch.only_one for layer in layers)
    assert [layer.switch.shown for layer in layers] == [True, False, False, False, False]
    values = [layer.levels[0, 0] * layer.unit for layer in layers]
    assert values == pytest.approx([0.5 / 0.9, 0.3, 0.2, 0.4, 0.1], abs=0.025)


def test_a_drive_is_its_way_its_keyframes_and_its_loops():
    poses = np.zeros((1000, 3))
    poses[:, 0] = np.linspace(0.0, 1.0, 1000)
    scans = [LaserScan(float(k), 0.0, 0.1, 0.1, 10.0, np.array([2.0])) for k in range(3)]
    keyframes = Keyframes.from_scans(scans, [SE2(0.1 * k, 0.0, 0.0) for k in range(3)], [SE2.identity()] * 3)
    drive = Drive("r", Trajectory(np.arange(1000.0), poses), keyframes, np.array([[0, 2]]))
    way, dots, links = drive_layers([drive], [(1, 2, 3)], "Robots", 0.1)
    assert 15 <= len(way.points) <= 25
    np.testing.assert_array_equal(way.points[[0, -1]], poses[[0, -1], :2])
    np.testing.assert_allclose(dots.points[:, 0], [0.0, 0.1, 0.2])
    np.testing.assert_allclose(links.points[:, 0], [0.0, 0.2])
    assert [layer.kind for layer in (way, dots, links)] == ["line", "dots", "links"]


def test_trouble_is_where_the_robot_was_then():
    way = Trajectory(np.array([10.0, 11.0, 12.0]), np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.0], [3.0, 4.0, 0.0]]))
    drive = Drive("r", way, Keyframes.from_scans([], [], []))
    incidents = [{"stamp": 11.2, "what": "no odometry"}, {"stamp": 99, "what": "<b>"}, {"what": "no stamp"}, 3]
    (mark,) = incident_layer(drive, incidents, "Robots")
    np.testing.assert_array_equal(mark.points, [[1.0, 2.0], [3.0, 4.0]])
    assert mark.texts == ["1.0 s: no odometry", "2.0 s: <b>"]
    (mark,) = incident_layer(drive, [{"stamp": 10.0, "at_s": 0.0, "what": "a scale", "all_along": True}], "Robots")
    assert mark.texts == ["all along: a scale"]
    assert incident_layer(drive, None, "Robots") == incident_layer(drive, [], "Robots") == []


def test_large_maps_are_shown_in_coarser_cells_that_cover_the_same_place(monkeypatch):
    monkeypatch.setattr(map_layers, "MOST_CELLS", 30)
    cells = np.zeros((11, 10, 4), dtype=np.float32)
    cells[..., OCCUPIED] = 1.0
    geometry, coarse = for_display(GridGeometry(0.1, -1.0, 2.0, 11, 10), lambda first, last: cells[first:last])
    assert (geometry.rows, geometry.cols) == (6, 5)
    assert geometry.resolution == pytest.approx(0.2)
    assert coarse.shape == (6, 5, 4)
    np.testing.assert_allclose(coarse[..., OCCUPIED], 1.0)
    assert (geometry.origin_x, geometry.origin_y) == (-1.0, 2.0)


def test_a_large_map_is_made_coarser_without_a_copy_of_it(generator, monkeypatch):
    """And as it is at once: blocks of six by six, some of them beyond the border."""
    monkeypatch.setattr("tbmslam.report.map_layers.MOST_CELLS", 100_000)
    cells = generator.random((1999, 1501, 4)).astype(np.float32)
    tracemalloc.start()
    geometry, coarse = for_display(GridGeometry(0.05, 0.0, 0.0, 1999, 1501), lambda first, last: cells[first:last])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.4 * cells.nbytes
    assert (geometry.rows, geometry.cols) == coarse.shape[:2] == (334, 251)
    assert geometry.resolution == pytest.approx(0.3)
    rows, cols = (np.minimum(np.arange(size), last) for size, last in ((2004, 1998), (1506, 1500)))
    expected = cells[rows][:, cols].reshape(334, 6, 251, 6, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse, expected, atol=1e-5)
