"""The direction that a fit does not determine, such as along a corridor."""

import math

import numpy as np

from tbmslam.geometry.se2 import FloatArray


def open_direction(hessian: FloatArray, least: float) -> FloatArray | None:
    """Return the direction (2,) that a fit does not determine; None if it determines all.

    `hessian` (3, 3) is the curvature in x, y and theta. `least` is the least curvature of a determined direction
    relative to the direction across it.
    """
    (xx, xy), (_, yy) = hessian[:2, :2].tolist()
    middle, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    spread = math.hypot(half, xy)
    if middle - spread >= least * (middle + spread):
        return None
    weak = 0.5 * math.atan2(xy, half) + 0.5 * math.pi
    return np.array([math.cos(weak), math.sin(weak)])


def without_open_direction(hessian: FloatArray, least: float) -> FloatArray:
    """Return the curvature (3, 3) without the direction that a fit does not determine.

    Along a corridor many poses fit, but they determine the distance of its walls and its direction.
    """
    direction = open_direction(hessian, least)
    if direction is None:
        return hessian
    kept = np.eye(3)
    kept[:2, :2] -= np.outer(direction, direction)
    closed: FloatArray = kept @ hessian @ kept
    return closed
