import numpy as np
import pytest

from tbmslam.belief.evidence_grid import EvidenceGrid
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2
from tbmslam.map.rendering import InsertionConfig, ScanInserter
from tbmslam.sensing.laser_scan import LaserScan
from tbmslam.sensing.sensor_model import SensorModelConfig
from tests.reference import is_inside

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


@pytest.mark.parametrize("once", [False, True])
def test_a_hit_marks_its_end_and_clears_its_way(once):
    at = mapped([2.0], once_per_scan=once)
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
    at = mapped([2.0, 3.0, 3.0, 3.0], once_per_scan=True)
    assert at(2.05)[OCCUPIED] == pytest.approx(0.38)
    assert at(2.05)[FREE] == pytest.approx(0.02)


def test_an_empty_scan_changes_nothing():
    grid = EvidenceGrid(0.1)
    scan = LaserScan(0.0, 0.0, 0.1, 0.1, 5.0, np.array([]))
    ScanInserter(MODEL, InsertionConfig()).insert(scan, SE2.identity(), grid)
    assert grid.geometry.rows == 0
