import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory
from tools.benchmarks.recordings import NoTruthError, drive_errors, truth_beside

FRAME = SE2(4.0, -7.0, 2.0)


def along(stamps):
    """Return a robot that goes a metre a second."""
    stamps = np.asarray(stamps, dtype=np.float64)
    return Trajectory(stamps, np.column_stack((stamps, 0.0 * stamps, 0.0 * stamps)))


def relations_file(folder, pairs):
    """Write relations which say that it goes a metre a second and 0.1 m aside."""
    path = folder / "run.relations"
    path.write_text("".join(f"{a} {b} {b - a} 0.1 0 0 0 0\n" for a, b in pairs))
    return path


def truth_file(folder, stamps):
    path = folder / "run.truth.tum"
    path.write_text("".join(f"{stamp} {stamp} 0 0 0 0 0 1\n" for stamp in stamps))
    return path


def test_the_truth_is_found_beside_the_recording(tmp_path):
    with pytest.raises(NoTruthError, match=r"run\.bag: has no \.relations and no \.truth\.tum beside it"):
        truth_beside(tmp_path / "run.bag")
    truth = truth_file(tmp_path, [0, 1])
    assert truth_beside(tmp_path / "run.bag") == truth
    relations = relations_file(tmp_path, [(0, 1)])
    assert truth_beside(tmp_path / "run.bag") == relations


def test_relations_between_estimated_poses_are_scored(tmp_path):
    path = relations_file(tmp_path, [(0, 1), (1, 5), (5, 6), (0, 8), (6, 20)])
    errors = drive_errors(path, along(range(8)).transformed(FRAME), np.arange(10.0))
    assert errors.kind == "relations"
    assert errors.scored().tolist() == [True, True, True, False, False]
    np.testing.assert_allclose(errors.metres[:3], 0.1, atol=1e-9)
    np.testing.assert_allclose(errors.degrees[:3], 0.0, atol=1e-9)
    assert errors.has_scans.tolist() == [True, True, True, True, False]


def test_means_are_those_of_what_is_asked_for(tmp_path):
    path = relations_file(tmp_path, [(0, 1), (2, 3)])
    turned = Trajectory(np.arange(4.0), np.array([[0, 0, 0], [1, 0.1, 0], [2, 0, 0], [3, 0.4, np.radians(2)]]))
    errors = drive_errors(path, turned, turned.stamps)
    assert errors.error_m(np.array([True, True])) == pytest.approx(0.15)
    assert errors.error_deg(np.array([False, True])) == pytest.approx(2.0)
    assert errors.error_m(np.array([False, False])) is None
    assert errors.error_deg(np.array([False, False])) is None


def test_poses_are_scored_after_a_rigid_alignment(tmp_path):
    path = truth_file(tmp_path, [*range(10), 9.5])
    estimate = along(range(4, 9)).transformed(FRAME)
    estimate.poses[0, :2] += 0.3
    errors = drive_errors(path, estimate, np.arange(10.0))
    assert errors.kind == "poses"
    assert errors.scored().tolist() == [4 <= stamp < 9 for stamp in [*range(10), 9.5]]
    assert 0.05 < errors.error_m(errors.scored()) < 0.3
    assert errors.error_deg(errors.scored()) is None
    assert errors.has_scans.tolist() == [True] * 10 + [False]


@pytest.mark.parametrize("stamps", [[], [3]])
def test_less_than_two_poses_cannot_be_scored(tmp_path, stamps):
    estimate = along(stamps)
    assert not drive_errors(truth_file(tmp_path, range(5)), estimate, np.arange(5.0)).scored().any()
    assert not drive_errors(relations_file(tmp_path, [(0, 1)]), estimate, np.arange(5.0)).scored().any()
