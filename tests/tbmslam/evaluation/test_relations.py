import numpy as np
import pytest

from tbmslam.evaluation.relations import RelationsError, read_relations, relation_errors
from tbmslam.geometry.se2 import SE2
from tbmslam.geometry.trajectory import Trajectory


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
