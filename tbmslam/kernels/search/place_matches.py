"""Places of one map matched to places of another: how many matches could be right together."""

import math

import numpy as np

from tbmslam.kernels import FloatArray, IntArray, kernel


@kernel
def common_weight(
    places: FloatArray, others: FloatArray, matched: IntArray, weights: FloatArray, tolerance: float, nearest: float
) -> float:
    """Return the weight of the largest set of matches that keep the distances between places.

    It is the largest eigenvalue of the matrix of matches that agree two by two (Leordeanu and Hebert 2005, section 2),
    by `_ROUNDS` of the power iteration.

    Parameters
    ----------
    places, others
        Places (P, 2) of one map and (Q, 2) of another [m].
    matched
        For each place of the first map its match among the others (P,).
    weights
        How likely each match is right (P,).
    tolerance
        Distances that differ by less agree [m].
    nearest
        Two places nearer to each other than this look alike by themselves, and say nothing [m].
    """
    count = len(places)
    agreeing = np.zeros((count, count))
    for i in range(count):
        for k in range(i):
            here = math.hypot(places[i, 0] - places[k, 0], places[i, 1] - places[k, 1])
            a, b = matched[i], matched[k]
            there = math.hypot(others[a, 0] - others[b, 0], others[a, 1] - others[b, 1])
            if here > nearest and there > 0.5 * nearest and abs(here - there) < tolerance:
                agreeing[i, k] = agreeing[k, i] = math.sqrt(weights[i] * weights[k])
    vector, length = weights.copy(), 0.0
    for _ in range(_ROUNDS):
        turned = np.zeros(count)
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
