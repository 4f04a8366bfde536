import numpy as np
import pytest

from tbmslam.map.drive_motions import DriveMotions


def test_steps_are_counted():
    assert len(DriveMotions(np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)))) == 4
    assert len(DriveMotions(np.zeros((0, 3)), np.zeros((0, 3, 3)))) == 0


@pytest.mark.parametrize(
    ("steps", "informations", "message"),
    [
        (
            np.zeros((2, 3)),
            np.zeros((3, 3, 3)),
            r"must have shapes \(S, 3\) and \(S, 3, 3\), got \(2, 3\) and \(3, 3, 3\)",
        ),
        (np.full((1, 3), np.nan), np.eye(3)[None], "must be finite"),
        (np.zeros((1, 3)), np.full((1, 3, 3), np.inf), "must be finite"),
        (
            np.zeros((1, 3)),
            np.array([[[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]),
            "must be symmetric and pos",
        ),
        (np.zeros((1, 3)), 1e13 * np.eye(3)[None], "with eigenvalues from 1e-12 to 1e\\+12"),
        (np.zeros((1, 3)), np.diag([1.0, 0.0, 1.0])[None], "must be symmetric and positive definite"),
    ],
)
def test_what_is_no_motion_is_refused(steps, informations, message):
    with pytest.raises(ValueError, match=message):
        DriveMotions(steps, informations)
