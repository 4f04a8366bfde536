import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tbmslam.evaluation.relations import (
    RelationsError,
    matching_poses,
    matching_stamps,
    read_relations,
    relation_errors,
)
from tbmslam.evaluation.trajectory_errors import align_trajectories, relative_errors
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory


def stepping_back(count=400, seconds=(0.2, 3.0, 30.0), period=0.1):
    """Return stamps, at an even rate, of a clock that is set back now and then; later ones are as those before."""
    back = np.zeros(count)
    for number, by in enumerate(seconds, 1):
        back[number * count // (len(seconds) + 1) :] += by
    return np.round(1000.0 + period * np.arange(count) - back, 6)


def all_of(stamps, chosen, tolerance=0.01):
    found, matched = matching_poses(stamps, stamps[chosen], tolerance)
    return found.tolist(), matched.tolist()


@pytest.mark.parametrize("chosen", [slice(None), slice(90, 400), slice(150, 290), slice(0, 400, 3)])
def test_each_pose_is_matched_with_itself_where_stamps_step_back(chosen):
    stamps = stepping_back()
    expected = np.arange(len(stamps))[chosen].tolist()
    assert all_of(stamps, chosen) == (expected, list(range(len(expected))))


def test_each_pose_is_matched_with_itself_where_stamps_come_twice():
    stamps = np.repeat(np.arange(50.0), 2)
    assert all_of(stamps, slice(None))[0] == list(range(100))


@given(st.sets(st.integers(0, 399), max_size=40))
def test_poses_that_the_second_lacks_change_nothing(missing):
    chosen = np.array([k for k in range(400) if k not in missing])
    assert np.mean(np.array(all_of(stepping_back(), chosen)[0]) == chosen) > 0.97


def test_where_stamps_rise_the_nearest_ones_match():
    found, matched = matching_poses(np.array([1.0, 2.0, 3.0]), np.array([3.004, 2.6, 1.0]), 0.01)
    assert (found.tolist(), matched.tolist()) == ([2, 0], [0, 2])
    assert [len(part) for part in matching_poses(np.array([2.0, 1.0]), np.zeros(0), 1.0)] == [0, 0]
    assert [len(part) for part in matching_poses(np.array([2.0, 1.0]), np.ones(1) * 9, 1.0)] == [0, 0]


def test_a_clock_at_rest_takes_bounded_memory():
    found, matched = matching_poses(np.zeros(2000), np.zeros(300), 0.01)
    assert len(found) == len(matched) == 300


def test_an_estimate_without_fault_has_none_where_stamps_step_back():
    stamps, generator = stepping_back(), np.random.default_rng(2)
    poses = np.cumsum(generator.uniform(-0.1, 0.3, (len(stamps), 3)), axis=0)
    truth, part = Trajectory(stamps, poses), slice(120, 330)
    estimate = Trajectory(stamps[part], poses[part])
    assert align_trajectories(truth, estimate).ate_m < 1e-9
    assert align_trajectories(truth, estimate).errors_m.max() < 1e-9
    assert relative_errors(truth, estimate, distance=1.0).translations_m.max() < 1e-9


def test_nearest_stamps_in_any_order():
    first, second = matching_stamps(np.array([3.0, 1.0, 2.0]), np.array([1.004, 2.6, 3.0, 9.0]), 0.01)
    assert first.tolist() == [1, 0]
    assert second.tolist() == [0, 2]
    assert [len(part) for part in matching_stamps(np.zeros(0), np.ones(2), 1.0)] == [0, 0]


def write(path, rows):
    path.write_text("# t1 t2 x y z roll pitch yaw\n" + "\n".join(" ".join(map(str, row)) for row in rows))
    return path


def test_errors_are_those_of_relative_motions(tmp_path):
    poses = np.array([[0, 0, np.pi / 2], [0, 1, np.pi / 2], [0, 2, 0.0]])
    trajectory = Trajectory(np.array([1e9, 1e9 + 0.2, 1e9 + 0.4]), poses)
    path = write(
        tmp_path / "a.relations",
        [
            (1e9, 1e9 + 0.2, 1.3, 0.4, 9, 9, 9, 0.0),
            (1e9, 1e9 + 77, 0, 0, 0, 0, 0, 0),
            (1e9, 1e9 + 0.4, 2.0, 0.0, 0, 0, 0, -np.pi / 2 + np.radians(2)),
        ],
    )
    errors = relation_errors(read_relations(path), trajectory)
    np.testing.assert_allclose(errors.translations_m, [0.5, 0.0], atol=1e-9)
    np.testing.assert_allclose(errors.rotations_deg, [0.0, 2.0], atol=1e-9)
    assert errors.unmatched == 1
    assert errors.checked.tolist() == [0, 2]
    assert errors.pairs.tolist() == [[0, 1], [0, 2]]


def test_the_frame_of_the_trajectory_does_not_matter(tmp_path):
    path = write(tmp_path / "a.relations", [(0, 1, 1.0, 0.0, 0, 0, 0, 0.1)])
    trajectory = Trajectory(np.array([0.0, 1.0]), np.array([[0, 0, 0], [1.0, 0.1, 0.1]]))
    first = relation_errors(read_relations(path), trajectory)
    second = relation_errors(read_relations(path), trajectory.transformed(SE2(5, -3, 2)))
    np.testing.assert_allclose(first.translations_m, second.translations_m)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1 2 3\n", "expected lines of eight finite numbers"),
        ("1 2 3 4 5 6 7 nan\n", "expected lines of eight finite numbers"),
        ("a b\n", "cannot be read as relations"),
    ],
)
def test_bad_files(tmp_path, content, message):
    path = tmp_path / "bad.relations"
    path.write_text(content)
    with pytest.raises(RelationsError, match=message):
        read_relations(path)


def test_missing_file(tmp_path):
    with pytest.raises(RelationsError, match=r"none.relations: cannot be read"):
        read_relations(tmp_path / "none.relations")
