"""How much of a pose a measurement determined, and how much of it a guess did."""

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel


@kernel
def determined_shares(
    information: npt.NDArray[np.float64], deviations: npt.NDArray[np.float64]
) -> tuple[float, float, float]:
    """Return how much, in [0, 1], of each coordinate of a pose a measurement determines against a guess.

    That is the diagonal of (H + P^-1)^-1 H = I - (H + P^-1)^-1 P^-1, the gain of a Kalman filter, with the
    measurement's information H (3, 3) and the guess's covariance P, of which `deviations` (3,) are the roots.
    """
    pa, pb, pc = deviations[0] ** -2.0, deviations[1] ** -2.0, deviations[2] ** -2.0
    a, b, c = information[0, 0] + pa, information[1, 1] + pb, information[2, 2] + pc
    d, e, f = information[0, 1], information[0, 2], information[1, 2]
    minor_a, minor_b, minor_c = b * c - f * f, a * c - e * e, a * b - d * d
    determinant = a * minor_a - d * (d * c - f * e) + e * (d * f - b * e)
    return (
        1.0 - pa * minor_a / determinant,
        1.0 - pb * minor_b / determinant,
        1.0 - pc * minor_c / determinant,
    )
