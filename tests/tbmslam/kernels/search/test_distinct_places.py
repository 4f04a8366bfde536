import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tbmslam.geometry.se2 import wrap_angle
from tbmslam.kernels.search.distinct_places import distinct_places


def slow_distinct(poses, ranked, apart_m, apart_rad, count):
    """The same, each place held against all better ones."""
    kept = []
    for index in ranked:
        near = [
            math.dist(poses[index][:2], poses[one][:2]) < apart_m
            and abs(wrap_angle(poses[index][2] - poses[one][2])) < apart_rad
            for one in kept
        ]
        if not any(near):
            kept.append(int(index))
    return kept[:count]


@given(
    st.integers(0, 30).flatmap(lambda n: arrays(np.float64, (n, 3), elements=st.floats(-4.0, 4.0))), st.integers(1, 10)
)
def test_the_best_places_that_are_near_no_better_one_are_kept(poses, count):
    ranked = np.random.default_rng(len(poses)).permutation(len(poses))
    kept = np.empty(count, dtype=np.int64)
    found = distinct_places(poses, ranked, 1.5, 0.5, kept)
    assert kept[:found].tolist() == slow_distinct(poses, ranked, 1.5, 0.5, count)
