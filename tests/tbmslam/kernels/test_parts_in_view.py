"""Which ends of beams are no places, against plain twins."""

import math

import numpy as np

from tbmslam.kernels.parts_in_view import count_refuted, follow_ranges, refuted_runs, smoothed_ranges
from tbmslam.se2 import SE2

DEPTH, BESIDE, UNSURE = 0.1, 0.05, 0.035
FIRST, STEP, BEAMS = -2.0, 0.02, 200
LIMITS = (math.inf, DEPTH, BESIDE, UNSURE)


def test_smoothed_ranges_are_medians_where_all_return():
    rng = np.random.default_rng(0)
    ranges = rng.uniform(0.1, 5.0, 100)
    ranges[[7, 30]] = np.nan, np.inf
    smooth = smoothed_ranges(ranges)
    for i in range(1, 99):
        three = ranges[i - 1 : i + 2]
        np.testing.assert_equal(smooth[i], np.median(three) if np.isfinite(three).all() else ranges[i])


def test_constant_ranges_are_followed_by_their_mean():
    state = np.full((5, 4), np.nan)
    looks = np.array([(0.50, 0.5, 0.5, 5.0), (0.52, 0.8, np.nan, 5.0), (0.48, 0.8, 0.51, 5.0)])
    for k, ranges in enumerate(looks):
        follow_ranges(state, ranges, (10.0 + k, 0.5 * k), (0.04, 3.0))
    np.testing.assert_allclose(state[0], (0.5, 0.8, 0.505, np.nan))
    np.testing.assert_array_equal(state[1, :3], (10.0, 11.0, 10.0))
    np.testing.assert_array_equal(state[2, :3], (0.0, 0.5, 0.0))
    np.testing.assert_array_equal(state[3, :3], (3.0, 2.0, 2.0))


def plainly_refuted(end, there, before, other, seen):
    """Tell it by points: none of the other's beams near the end may fall short of it, nor the laser have been there."""
    place = there.apply(np.array(end))
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    way = np.array(before[:2]) * (1.0 - share) + np.array(other[:2]) * share
    if np.hypot(*(way - place).T).min() < BESIDE:
        return True
    x, y = other.inverse().apply(place)
    distance = math.hypot(x, y)
    if distance <= BESIDE:
        return False
    turn = ((math.atan2(y, x) - FIRST) % (2.0 * math.pi)) / STEP
    wide = (math.asin(BESIDE / distance) + UNSURE) / STEP
    first, last = math.floor(turn - wide), math.ceil(turn + wide)
    if first < 0 or last >= BEAMS or not seen[round(turn)] >= distance + DEPTH:
        return False
    near = seen[first : last + 1]
    return bool((near[np.isfinite(near)] >= distance + DEPTH).all() and np.isfinite(near).mean() >= 0.8)


def test_refuted_ends_are_those_of_the_twin():
    rng = np.random.default_rng(5)
    agreed = 0
    for _ in range(30):
        count = 5
        lasers = np.column_stack((rng.uniform(0.0, 1.0, (count, 2)), rng.uniform(-1.0, 1.0, count)))
        seen = np.repeat(rng.uniform(0.2, 3.0, (count, BEAMS // 20)), 20, axis=1)
        seen[rng.random(seen.shape) < 0.05] = np.nan
        stamps = np.arange(count, dtype=np.float64)
        state = np.zeros((5, BEAMS))
        state[3] = 2.0
        state[1] = rng.integers(0, 3, BEAMS)
        refuted = np.zeros((count, BEAMS), dtype=np.bool_)
        count_refuted(state, refuted, (FIRST, STEP), lasers, stamps, seen, LIMITS)
        poses = [SE2.from_array(laser) for laser in lasers]
        expected = np.zeros_like(refuted)
        for k in (0, 2, 4):
            for i in range(BEAMS):
                if stamps[k] < state[1, i] or not np.isfinite(seen[k, i]):
                    continue
                angle = FIRST + i * STEP
                end = seen[k, i] * math.cos(angle), seen[k, i] * math.sin(angle)
                others = (0, 2) if k == 4 else (4,)
                expected[k, i] = any(
                    plainly_refuted(end, poses[k], poses[max(other - 2, 0)], poses[other], seen[other])
                    for other in others
                )
        agreed += int((refuted == expected).sum())
        np.testing.assert_array_equal(state[4], refuted.sum(axis=0))
        assert refuted.any()
    assert agreed >= 30 * 5 * BEAMS - 5  # a point on the way is within the limit, or a hair's breadth beside


def test_runs_need_sure_beams_and_take_their_neighbours_along():
    state = np.zeros((5, 20))
    state[2] = 9.0  # constant since lately
    state[2, 3:9], state[4, 3:9] = 0.4, 1.0
    state[2, 4:7], state[4, 4:7] = 0.0, 3.0
    state[2, 12:14], state[4, 12:14] = 0.0, 3.0
    assert np.flatnonzero(refuted_runs(state, 1.0, (1.0, 3.0, 3))).tolist() == [3, 4, 5, 6, 7, 8]


def test_beams_with_hardly_any_step_or_none_see_through_nothing_behind_them():
    for step, beams in ((0.0, 1), (1e-320, 5), (-1e-320, 5)):
        looks = 4
        lasers = np.array([(0.0, 0.2 * k, 0.3 * k) for k in range(looks)])
        seen, refuted = np.full((looks, beams), 2.0), np.zeros((looks, beams), dtype=np.bool_)
        state = np.zeros((5, beams))
        state[0], state[3] = 2.0, float(looks)
        count_refuted(state, refuted, (0.0, step), lasers, np.arange(float(looks)), seen, LIMITS)
        assert not refuted.any()
