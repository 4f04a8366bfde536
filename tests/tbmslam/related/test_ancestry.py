import numpy as np
import pytest

from tbmslam.related.ancestry import Ancestry


def test_weights_and_their_effective_number():
    ancestry = Ancestry(4)
    assert ancestry.effective_number() == pytest.approx(4.0)
    ancestry.weigh(np.log([1.0, 1.0, 2.0, 4.0]) - 1000.0)
    np.testing.assert_allclose(ancestry.weights(), [0.125, 0.125, 0.25, 0.5])
    assert ancestry.effective_number() == pytest.approx(64.0 / 22.0)
    assert ancestry.best() == 3


@pytest.mark.parametrize("draw", [0.1, 0.5, 0.9])
def test_descendants_are_as_many_as_the_weight_says(draw):
    ancestry = Ancestry(8)
    weights = np.array([0.0, 1.0, 2.0, 5.0, 0.0, 0.0, 0.0, 0.0]) + 1e-12
    ancestry.weigh(np.log(weights))
    chosen = ancestry.resample(draw)
    np.testing.assert_array_equal(np.bincount(chosen, minlength=4)[1:4], [1, 2, 5])
    assert ancestry.effective_number() == pytest.approx(8.0)


def test_the_path_is_that_of_the_best_ones_ancestors():
    ancestry = Ancestry(3)
    assert ancestry.path().shape == (0, 3)
    poses = np.arange(9.0).reshape(3, 3)
    ancestry.record(poses)
    ancestry.weigh(np.log([0.1, 0.1, 0.8]))
    chosen = ancestry.resample(0.5)
    ancestry.record(poses[chosen] + 10.0)
    ancestry.weigh(np.array([1.0, 0.0, 0.0]))
    np.testing.assert_array_equal(ancestry.path(), [poses[chosen[0]], poses[chosen[0]] + 10.0])
