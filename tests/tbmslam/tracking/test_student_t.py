import numpy as np
import pytest
from scipy import stats

from tbmslam.tracking.student_t import FREEDOM, student_cost, student_weight


@pytest.mark.parametrize("dimensions", [1, 2, 3])
@pytest.mark.parametrize("distance", [0.1, 1.0, 20.0])
def test_the_weight_is_that_of_least_squares_with_the_slope_of_the_density(dimensions, distance):
    """The cost of a normal distribution, half the squared distance, has the slope 1/2 and the weight 1."""
    density = stats.multivariate_t(shape=np.eye(dimensions), df=FREEDOM)
    squared, step = distance**2, 1e-4 * distance**2
    less, more = (density.logpdf([np.sqrt(at)] + [0.0] * (dimensions - 1)) for at in (squared - step, squared + step))
    assert student_weight(squared, dimensions) == pytest.approx((less - more) / step, rel=1e-5)


def test_the_cost_is_that_of_three_dimensions():
    density = stats.multivariate_t(shape=np.eye(3), df=FREEDOM)
    assert student_cost(5.0) == pytest.approx(density.logpdf([0, 0, 0]) - density.logpdf([2, 1, 0]))
