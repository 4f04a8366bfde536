"""Share of a pose that a measurement determines, as opposed to its prior."""

import math

import numpy as np
import numpy.typing as npt

from tbmslam.kernels import kernel, part
from tbmslam.kernels.arrays import cleared


@part
def determined_shares(
    information: npt.NDArray[np.float64], deviations: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return the share, in [0, 1], of each coordinate of a pose that a measurement determines rather than the prior.

    It is the diagonal of (H + P^-1)^-1 H = I - (H + P^-1)^-1 P^-1, the gain of a Kalman filter, with the information
    H (3, 3) of the measurement and the prior covariance P, the squares of `deviations` (3,).
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


@kernel
def determined_of_robot(
    information: npt.NDArray[np.float64],
    deviations: tuple[float, float, float],
    heading: float,
    mount: tuple[float, float, float],
) -> tuple[float, float, float]:
    """Return the `determined_shares` of the robot's pose, with the information (3, 3) as for `seen_by_robot`."""
    return determined_shares(seen_by_robot(information, heading, mount), deviations)


@kernel
def prior_information(
    deviations: tuple[float, float, float], heading: float, mount: tuple[float, float, float]
) -> npt.NDArray[np.float64]:
    """Return the prior information (3, 3) of the laser's pose in the map's frame.

    `deviations` are those of the robot's pose along, across [m] and in heading [rad], `heading` is that of the robot in
    the map [rad], and `mount` the pose of the laser on the robot.
    """
    cosine, sine = math.cos(heading), math.sin(heading)
    along, across, turn = deviations[0] ** -2.0, deviations[1] ** -2.0, deviations[2] ** -2.0
    xx = along * cosine * cosine + across * sine * sine
    xy = (along - across) * cosine * sine
    yy = along * sine * sine + across * cosine * cosine
    # The position of the robot is that of the laser minus the rotation of the lever: x = x' + ly t, y = y' - lx t.
    lx, ly = cosine * mount[0] - sine * mount[1], sine * mount[0] + cosine * mount[1]
    xt, yt = xx * ly - xy * lx, xy * ly - yy * lx
    information = np.empty((3, 3))
    information[0, 0], information[0, 1], information[0, 2] = xx, xy, xt
    information[1, 0], information[1, 1], information[1, 2] = xy, yy, yt
    information[2, 0], information[2, 1], information[2, 2] = xt, yt, turn + ly * xt - lx * yt
    return information


@part
def seen_by_robot(
    information: npt.NDArray[np.float64], heading: float, mount: tuple[float, float, float]
) -> npt.NDArray[np.float64]:
    """Convert information (3, 3) of the laser's pose in the map's frame to the robot's pose in its own frame.

    This is the opposite of `prior_information`, with the same `heading` [rad] and `mount`.
    """
    cosine, sine = math.cos(heading), math.sin(heading)
    lx, ly = cosine * mount[0] - sine * mount[1], sine * mount[0] + cosine * mount[1]
    jacobian, carried, seen = cleared(np.empty((3, 3))), cleared(np.empty((3, 3))), cleared(np.empty((3, 3)))
    jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = cosine, -sine, -ly
    jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = sine, cosine, lx
    jacobian[2, 2] = 1.0
    for a in range(3):
        for b in range(3):
            for c in range(3):
                carried[a, b] += information[a, c] * jacobian[c, b]
    for a in range(3):
        for b in range(3):
            for c in range(3):
                seen[a, b] += jacobian[c, a] * carried[c, b]
    return seen
