import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from merging.registration.non_maximum_suppression import distinct

LIMITS = 1.0, 0.15


def is_near(one, other):
    turn = abs((one[2] - other[2] + math.pi) % (2.0 * math.pi) - math.pi)
    return math.dist(one[:2], other[:2]) < LIMITS[0] and turn < LIMITS[1]


def test_the_best_of_places_close_together_is_kept():
    poses = np.array([(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (9.0, 0.0, 0.0)])
    assert distinct(poses, np.array([1.0, 2.0, 0.5]), *LIMITS, 5).tolist() == [1, 2]
    assert distinct(poses, np.array([1.0, 2.0, 0.5]), *LIMITS, 1).tolist() == [1]


def test_a_turn_makes_another_place_and_a_whole_circle_does_not():
    poses = np.array([(0.0, 0.0, -math.pi), (0.0, 0.0, math.pi - 0.1), (0.0, 0.0, -math.pi + 0.2)])
    assert distinct(poses, np.array([3.0, 2.0, 1.0]), *LIMITS, 5).tolist() == [0, 2]


def test_the_distance_itself_is_apart():
    poses = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    assert distinct(poses, np.zeros(2), *LIMITS, 5).tolist() == [0, 1]


def test_of_nothing_nothing_is_kept():
    assert distinct(np.empty((0, 3)), np.empty(0), *LIMITS, 5).tolist() == []


@given(st.integers(1, 30).flatmap(lambda n: arrays(np.float64, (n, 4), elements=st.floats(-3.0, 3.0))))
def test_what_is_kept_is_apart_and_what_is_not_is_near_something_better(drawn):
    poses, scores = drawn[:, :3], drawn[:, 3]
    kept = distinct(poses, scores, *LIMITS, len(poses)).tolist()
    assert list(scores[kept]) == sorted(scores[kept], reverse=True)
    for place, index in enumerate(kept):
        assert not any(is_near(poses[index], poses[other]) for other in kept[:place])
    for index in set(range(len(poses))) - set(kept):
        assert any(is_near(poses[index], poses[other]) and scores[other] >= scores[index] for other in kept)
