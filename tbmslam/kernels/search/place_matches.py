"""Consistency of matches between the places of two maps."""

import math

import numpy as np

from tbmslam.kernels import FloatArray, IntArray, kernel
from tbmslam.kernels.arrays import cleared


@kernel
def common_weight(
    places: FloatArray, others: FloatArray, matched: IntArray, weights: FloatArray, tolerance: float, nearest: float
) -> float:
    """Return the weight of the largest set of matches that preserve the distances between places.

    It is the largest eigenvalue of the matrix of pairwise consistent matches (Leordeanu and Hebert 2005, section 2), by
    `_ROUNDS` power iterations. Each of the `places` (P, 2) matches the place `matched` (P,) among the `others` (Q, 2)
    of another map [m], and `weights` (P,) are the probabilities that the matches are right. `tolerance` is the largest
    difference between consistent distances [m]. Places within `nearest` of each other are similar and carry no
    information [m].
    """
    count = len(places)
    agreeing = cleared(np.empty((count, count)))
    for i in range(count):
        for k in range(i):
            here = math.hypot(places[i, 0] - places[k, 0], places[i, 1] - places[k, 1])
            a, b = matched[i], matched[k]
            there = math.hypot(others[a, 0] - others[b, 0], others[a, 1] - others[b, 1])
            if here > nearest and there > 0.5 * nearest and abs(here - there) < tolerance:
                agreeing[i, k] = agreeing[k, i] = math.sqrt(weights[i] * weights[k])
    vector, length = weights.copy(), 0.0
    for _ in range(_ROUNDS):
        turned = cleared(np.empty(count))
        length = 0.0
        for i in range(count):
            for k in range(count):
                turned[i] += agreeing[i, k] * vector[k]
            length += turned[i] * turned[i]
        length = math.sqrt(length)
        if length == 0.0:
            return 0.0
        for i in range(count):
            vector[i] = turned[i] / length
    return length


_ROUNDS = 6
