"""Measured motions between sensor poses, as equations of small changes of the poses that carry the sensors."""

import math
from typing import NamedTuple

import numpy as np

from tbmslam.kernels import FloatArray, IntArray, kernel, part
from tbmslam.kernels.adjustment.pose_systems import MotionSystem, add_between
from tbmslam.kernels.arrays import cleared


class Motions(NamedTuple):
    """Measured motions."""

    ends: IntArray
    """Indices (E, 2) of the poses that carry the source and the target of each motion."""
    levers: FloatArray
    """The source and the target (E, 2, 3) in the frames of these poses."""
    measured: FloatArray
    """The motions (E, 3)."""
    informations: FloatArray
    """Inverse covariances (E, 3, 3) of the errors in the target's frame."""
    widths: FloatArray
    """Width (E,) of the Cauchy loss of each motion [standard deviations]; inf for least squares."""


@kernel
def motion_equations(motions: Motions, poses: FloatArray) -> tuple[FloatArray, MotionSystem, FloatArray]:
    """Linearise motions at poses (N, 3).

    A change of a pose is dx, dy in the map's frame and dtheta about its position. Returns the diagonal blocks (N, 3, 3)
    of the curvature, its other blocks, and the gradient (N, 3) of half the squared deviations.
    """
    own, gradient = cleared(np.empty((len(poses), 3, 3))), cleared(np.empty((len(poses), 3)))
    across = cleared(np.empty((len(motions.ends), 3, 3)))
    error, pull, slopes = np.empty(3), np.empty(3), cleared(np.empty((2, 3, 3)))
    for e in range(len(motions.ends)):
        source, target = motions.ends[e, 0], motions.ends[e, 1]
        _linearise(motions.levers[e], motions.measured[e], poses[source], poses[target], error, slopes)
        information, square = motions.informations[e], 0.0
        for i in range(3):
            pull[i] = information[i, 0] * error[0] + information[i, 1] * error[1] + information[i, 2] * error[2]
            square += pull[i] * error[i]
        say = 1.0 / (1.0 + square / motions.widths[e] ** 2)
        for end in range(2):
            k, slope = motions.ends[e, end], slopes[end]
            add_between(own[k], slope, information, slope, say)
            for i in range(3):
                gradient[k, i] += say * (slope[0, i] * pull[0] + slope[1, i] * pull[1] + slope[2, i] * pull[2])
        add_between(across[e], slopes[0], information, slopes[1], say)
        if source == target:
            for i in range(3):
                for j in range(3):
                    own[source, i, j] += across[e, i, j] + across[e, j, i]
            for i in range(3):
                for j in range(3):
                    across[e, i, j] = 0.0
    return own, MotionSystem(motions.ends, across), gradient


@part
def _linearise(
    levers: FloatArray,
    measured: FloatArray,
    source: FloatArray,
    target: FloatArray,
    error: FloatArray,
    slopes: FloatArray,
) -> None:
    """Write the error (3,) of a motion, in the measured target's frame, and its Jacobians (2, 3, 3) by both poses."""
    c, s = math.cos(source[2]), math.sin(source[2])
    arm_x, arm_y = c * levers[0, 0] - s * levers[0, 1], s * levers[0, 0] + c * levers[0, 1]
    c, s = math.cos(target[2]), math.sin(target[2])
    end_x, end_y = c * levers[1, 0] - s * levers[1, 1], s * levers[1, 0] + c * levers[1, 1]
    # Vectors from the source's pose and from its sensor to the target's sensor.
    far_x, far_y = target[0] + end_x - source[0], target[1] + end_y - source[1]
    way_x, way_y = far_x - arm_x, far_y - arm_y
    heading = source[2] + levers[0, 2]
    turn = target[2] + levers[1, 2] - heading - measured[2]
    c, s = math.cos(heading + measured[2]), math.sin(heading + measured[2])
    mc, ms = math.cos(measured[2]), math.sin(measured[2])
    error[0] = c * way_x + s * way_y - (mc * measured[0] + ms * measured[1])
    error[1] = c * way_y - s * way_x - (mc * measured[1] - ms * measured[0])
    error[2] = (turn + math.pi) % (2.0 * math.pi) - math.pi
    # A rotation of the source moves its sensor and rotates the measured motion.
    for end, x, y, sign in ((0, far_x, far_y, -1.0), (1, end_x, end_y, 1.0)):
        slopes[end, 0, 0], slopes[end, 0, 1], slopes[end, 0, 2] = sign * c, sign * s, sign * (s * x - c * y)
        slopes[end, 1, 0], slopes[end, 1, 1], slopes[end, 1, 2] = -sign * s, sign * c, sign * (c * x + s * y)
        slopes[end, 2, 2] = sign
