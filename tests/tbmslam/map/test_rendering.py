import numpy as np
import pytest

from tbmslam.belief.evidence_grid import EvidenceGrid, GridTooLargeError
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.rays.insertion import beams_of_scan
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.rendering import InsertionConfig, MapConfig, ScanInserter, render
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.sensing.sensor_model import SensorModelConfig
from tests import reference
from tests.belief_rules import normalise
from tests.reference import is_inside

MOUNT = SE2(0.21, 0.13, 0.31)


@pytest.fixture
def drive(generator):
    ranges = generator.uniform(0.5, 12.0, (6, 180))
    ranges[generator.random((6, 180)) < 0.1] = np.inf
    ranges[generator.random((6, 180)) < 0.1] = np.nan
    scans = [LaserScan(float(k), -1.0, 0.02, 0.1, 10.0, row) for k, row in enumerate(ranges)]
    poses = [SE2(0.3 * k, -0.2 * k, 0.4 * k) for k in range(6)]
    return Keyframes.from_scans(scans, poses, [MOUNT] * 6)


@pytest.mark.parametrize("keep_conflict", [True, False])
def test_it_is_what_inserting_scan_by_scan_gives(drive, keep_conflict):
    config = MapConfig(resolution=0.1, insertion=InsertionConfig(no_return="free"), keep_conflict=keep_conflict)
    grid = EvidenceGrid(config.resolution)
    inserter = ScanInserter(config.sensor_model, config.insertion)
    for index in [*range(6), *range(6)]:
        inserter.insert(drive.scan(index), drive.sensor_pose(index), grid)
    expected = grid.to_tbm_grid(keep_conflict).cropped_to_known()
    rendered = render([drive, drive], config)
    assert rendered.geometry == pytest.approx(expected.geometry, abs=1e-9)
    np.testing.assert_allclose(rendered.masses, expected.masses, atol=1e-6)


@pytest.mark.parametrize("insertion", [{}, {"no_return": "free", "max_range": 8.0}])
def test_each_scan_counts_once_in_a_cell(drive, insertion):
    insertion = InsertionConfig(once_per_scan=True, **insertion)
    limit, clears, cells = insertion.max_range, insertion.no_return == "free", {}
    for index in [*range(6), *range(6)]:
        scan, laser = drive.scan(index), drive.sensor_pose(index)
        directions, limits = (scan.angle_min, scan.angle_increment), (limit, min(limit, scan.range_max))
        starts, ends, is_hit, _ = beams_of_scan(scan.ranges, directions, scan.beam_step, laser, limits, clears)
        reference.insert_scan(cells, 0.1, starts[0], ends, is_hit, MapConfig().sensor_model, 1.0)
    for keep_conflict in (True, False):
        config = MapConfig(resolution=0.1, insertion=insertion, keep_conflict=keep_conflict)
        rendered = render([drive, drive], config)
        assert rendered.geometry.resolution == 0.1
        low = np.round(np.array([rendered.geometry.origin_y, rendered.geometry.origin_x]) / 0.1).astype(int)
        assert {tuple(cell) for cell in (np.argwhere(rendered.is_known()) + low).tolist()} == set(cells)
        rows, cols = (np.array(list(cells)) - low).T
        expected = np.array(list(cells.values()))
        np.testing.assert_allclose(
            rendered.masses[rows, cols], expected if keep_conflict else normalise(expected), atol=1e-6
        )


def test_no_keyframes_make_an_empty_grid():
    assert not render([], MapConfig()).is_known().any()
    blind = Keyframes.from_scans([LaserScan(0.0, 0.0, 0.1, 0.1, 9.0, np.full(5, np.nan))], [SE2.identity()], [MOUNT])
    assert not render([blind], MapConfig()).is_known().any()


def test_a_grid_beyond_the_limit_is_drawn_coarser(drive, caplog):
    fine, coarse = render([drive], MapConfig()), render([drive], MapConfig(max_cells=1000))
    assert 500 < coarse.geometry.rows * coarse.geometry.cols <= 1000
    times = coarse.geometry.resolution / 0.05
    assert times == pytest.approx(round(times))
    assert np.asarray(coarse.geometry.bounds()) == pytest.approx(fine.geometry.bounds(), abs=coarse.geometry.resolution)
    (warning,) = caplog.messages
    assert warning.endswith("instead of 0.05 m, to stay within the 1000 cells of map.max_cells")


def test_one_that_grows_beam_by_beam_is_refused_there(drive):
    with pytest.raises(GridTooLargeError, match="more than the limit of 1000 cells"):
        render([drive], MapConfig(max_cells=1000, insertion=InsertionConfig()))


def test_scans_are_drawn_some_at_a_time(drive, monkeypatch):
    at_once = render([drive, drive], MapConfig())
    monkeypatch.setattr("tbmslam.map.rendering._SCANS_AT_ONCE", 4)
    np.testing.assert_array_equal(render([drive, drive], MapConfig()).masses, at_once.masses)


@pytest.mark.parametrize("strip_bytes", [1, 150_000])
def test_counts_in_strips_give_the_same_bits(drive, monkeypatch, strip_bytes):
    blind = LaserScan(9.0, -1.0, 0.02, 0.1, 10.0, np.full(180, np.nan))
    scans, poses = [drive.scan(k) for k in range(6)], [drive.pose(k) for k in range(6)]
    drives = [drive, Keyframes.from_scans([*scans[:3], blind, *scans[3:]], [*poses, poses[0]], [MOUNT] * 7)]
    whole = render(drives, MapConfig())
    assert whole.geometry.rows > 300
    monkeypatch.setattr("tbmslam.map.rendering._LARGE_BYTES", 1000)
    monkeypatch.setattr("tbmslam.map.rendering._STRIP_BYTES", strip_bytes)
    strips = render(drives, MapConfig())
    assert strips.geometry == whole.geometry
    assert strips.masses.tobytes() == whole.masses.tobytes()


def test_scans_that_agree_leave_no_conflict_however_many():
    """And those that do not, as of a door that was shut, do."""
    open_door = LaserScan(0.0, -0.1, 0.02, 0.1, 9.0, np.full(11, 4.0))
    shut_door = LaserScan(0.0, -0.1, 0.02, 0.1, 9.0, np.full(11, 2.0))
    poses = [SE2(0.0, 0.0, 0.0)] * 400
    grid = render([Keyframes.from_scans([open_door] * 400, poses, [MOUNT] * 400)], MapConfig(resolution=0.1))
    assert grid.masses[..., CONFLICT].max() == 0.0
    assert grid.masses[..., FREE].max() > 0.999
    scans = [open_door] * 20 + [shut_door] * 5
    grid = render([Keyframes.from_scans(scans, poses[:25], [MOUNT] * 25)], MapConfig(resolution=0.1))
    assert grid.masses[..., CONFLICT].max() > 0.5


def test_few_scans_far_apart_are_refused_where_memory_is_short(monkeypatch):
    """Sixty scans over a square kilometre would take 1.7 GB."""
    poses = [SE2(1000.0 * (k % 8) / 7.0, 1000.0 * (k // 8) / 7.0, 0.0) for k in range(60)]
    scans = [LaserScan(float(k), -1.5, 0.1, 0.1, 30.0, np.full(30, 5.0)) for k in range(60)]
    drive = Keyframes.from_scans(scans, poses, [SE2.identity()] * 60)
    monkeypatch.setattr("tbmslam.map.rendering.machine_memory", lambda: 1_000_000_000)
    said = r"the map spans \d+ x \d+ m and takes 1\.\d GB to render, more than the 1\.0 GB available: use a smaller"
    with pytest.raises(GridTooLargeError, match=said):
        render([drive], MapConfig())
    assert render([drive], MapConfig(max_cells=30_000_000)).is_known().any()


START = SE2(0.05, 0.05, 0.0)
MODEL = SensorModelConfig(hit_quality=0.4, miss_quality=0.1, wall_blur=0.0)


def mapped(ranges, pose=START, **options):
    """Insert one beam a range, all along +x, and return a function from x to masses."""
    grid = EvidenceGrid(0.1)
    scan = LaserScan(0.0, 0.0, 0.0, 0.1, 5.0, np.asarray(ranges, dtype=np.float64))
    ScanInserter(MODEL, InsertionConfig(**options)).insert(scan, pose, grid)
    tbm_grid = grid.to_tbm_grid()

    def at(x, y=0.05):
        row, col = tbm_grid.geometry.cell_at(x, y)
        return tbm_grid.masses[row, col] if is_inside(tbm_grid.geometry, row, col) else np.array([0, 0, 0, 1.0])

    return at


def test_a_hit_marks_its_end_and_clears_its_way():
    at = mapped([2.0])
    assert at(2.05)[OCCUPIED] == pytest.approx(0.38)
    assert at(1.0)[FREE] == pytest.approx(0.099)
    assert at(2.25)[3] == 1.0


def test_no_return():
    assert mapped([np.inf], no_return="free")(4.9)[FREE] > 0.0
    assert mapped([np.inf], no_return="free")(5.2)[FREE] == 0.0
    assert mapped([np.inf], no_return="ignore")(1.0)[3] == 1.0
    assert mapped([np.nan], no_return="free")(1.0)[3] == 1.0


def test_beyond_the_maximum_a_hit_only_clears():
    at = mapped([4.0], max_range=3.0)
    assert at(2.9)[FREE] > 0.0
    assert at(3.3)[3] == 1.0
    assert at(4.05)[3] == 1.0


def test_a_turned_sensor():
    at = mapped([2.0], pose=SE2(0.05, 0.05, np.pi / 2))
    assert at(0.05, 2.05)[OCCUPIED] > 0.3


def test_a_hit_outweighs_passages_of_its_scan():
    scan = LaserScan(0.0, 0.0, 0.0, 0.1, 5.0, np.array([2.0, 3.0, 3.0, 3.0]))
    insertion = InsertionConfig(once_per_scan=True)
    config = MapConfig(resolution=0.1, sensor_model=MODEL, insertion=insertion, keep_conflict=False)
    grid = render([Keyframes.from_scans([scan], [START], [SE2.identity()])], config)
    masses = grid.masses[grid.geometry.cell_at(2.05, 0.05)]
    assert masses[OCCUPIED] == pytest.approx(0.38)
    assert masses[FREE] == pytest.approx(0.02)


def test_an_empty_scan_changes_nothing():
    grid = EvidenceGrid(0.1)
    scan = LaserScan(0.0, 0.0, 0.1, 0.1, 5.0, np.array([]))
    ScanInserter(MODEL, InsertionConfig()).insert(scan, SE2.identity(), grid)
    assert grid.geometry.rows == 0
