"""Student's t distribution of the errors of odometry."""

import math

FREEDOM = 4.0
"""Degrees of freedom: about one correction in twenty is a slip."""


def student_cost(squared: float) -> float:
    """Return the negative log-likelihood of a squared Mahalanobis distance in three dimensions, 0 at the mean."""
    return 0.5 * (FREEDOM + 3.0) * math.log1p(squared / FREEDOM)


def student_weight(squared: float, dimensions: int) -> float:
    """Return the weight that least squares give a residual under Student's t distribution; outliers have little.

    K. Lange et al., "Robust statistical modeling using the t distribution", JASA 1989.

    Parameters
    ----------
    squared
        Squared Mahalanobis distance of the residual from the mean.
    dimensions
        Number of coordinates of the residual.
    """
    return (FREEDOM + dimensions) / (FREEDOM + squared)
