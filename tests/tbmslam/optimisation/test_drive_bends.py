import numpy as np
import pytest

from tbmslam.optimisation.drive_bends import bends_of


@pytest.mark.parametrize("ends", [[0, 1], [0, 2], [0, 20], [0, 1, 1 + 17, 18 + 2], [0, 5000]])
def test_each_pose_lies_between_two_knots_of_its_own_drive(ends):
    bends = bends_of(ends)
    knots = bends.knots[bends.sides]
    poses = np.arange(ends[-1])
    np.testing.assert_allclose(bends.shares.sum(axis=1), 1.0)
    np.testing.assert_allclose((bends.shares * knots).sum(axis=1), poses, atol=1e-9)
    assert np.all(bends.shares >= 0.0)
    drive = np.searchsorted(ends, poses, side="right")
    np.testing.assert_array_equal(np.searchsorted(ends, knots, side="right"), np.column_stack((drive, drive)))


def test_long_drives_have_a_limited_number_of_knots():
    assert 4 <= len(bends_of([0, 20]).knots) <= 5
    assert len(bends_of([0, 100_000]).knots) <= 252
    assert len(bends_of(np.linspace(0, 100_000, 11).astype(int).tolist()).knots) <= 270
