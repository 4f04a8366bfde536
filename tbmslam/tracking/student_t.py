"""Student's t distribution of the errors of odometry."""

import math

FREEDOM = 4.0
"""Degrees of freedom: about one correction in twenty is a slip."""


def student_cost(squared: float) -> float:
    """Return the negative log-likelihood of a squared Mahalanobis distance under Student's t, 0 at the mean."""
    return 0.5 * (FREEDOM + 3.0) * math.log1p(squared / FREEDOM)
