import numpy as np
import pytest

from tbmslam.config import MapConfig
from tbmslam.evidence_grid import EvidenceGrid, GridTooLargeError
from tbmslam.keyframes import Keyframes
from tbmslam.laser_scan import LaserScan
from tbmslam.mapping import InsertionConfig, ScanInserter
from tbmslam.rendering import render
from tbmslam.se2 import SE2

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
@pytest.mark.parametrize(
    "insertion",
    [
        {"once_per_scan": True},
        {"once_per_scan": True, "no_return": "free", "max_range": 8.0},
        {"once_per_scan": False, "no_return": "free"},
    ],
)
def test_it_is_what_inserting_scan_by_scan_gives(drive, insertion, keep_conflict):
    config = MapConfig(resolution=0.1, insertion=InsertionConfig(**insertion), keep_conflict=keep_conflict)
    grid = EvidenceGrid(config.resolution)
    inserter = ScanInserter(config.sensor_model, config.insertion)
    for index in [*range(6), *range(6)]:
        inserter.insert(drive.scan(index), drive.sensor_pose(index), grid)
    expected = grid.to_tbm_grid(keep_conflict).cropped_to_known()
    rendered = render([drive, drive], config)
    assert rendered.geometry == pytest.approx(expected.geometry, abs=1e-9)
    np.testing.assert_allclose(rendered.masses, expected.masses, atol=1e-6)


def test_no_keyframes_make_an_empty_grid():
    assert not render([], MapConfig()).is_known().any()
    blind = Keyframes.from_scans([LaserScan(0.0, 0.0, 0.1, 0.1, 9.0, np.full(5, np.nan))], [SE2.identity()], [MOUNT])
    assert not render([blind], MapConfig()).is_known().any()


def test_a_grid_beyond_the_limit_is_refused(drive):
    with pytest.raises(GridTooLargeError, match="more than the limit of 100 cells"):
        render([drive], MapConfig(max_cells=100))
