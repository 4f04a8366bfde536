import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.rays.hits import hit_points, place_hits, write_normals
from tests import reference

STILL = SE2(0.0, 0.0, 0.0)


def ragged_ranges(generator, count=200):
    ranges = np.cumsum(generator.normal(0.0, 0.05, count)) + 4.0
    ranges[generator.integers(0, count, 20)] += 2.0
    ranges[generator.integers(0, count, 20)] = np.nan
    ranges[generator.integers(0, count, 20)] = np.inf
    return ranges


@pytest.mark.parametrize("seed", range(5))
def test_points_are_the_plain_ones(seed):
    ranges = ragged_ranges(np.random.default_rng(seed))
    expected = [
        (r * math.cos(-1.0 + 0.01 * i), r * math.sin(-1.0 + 0.01 * i))
        for i, r in enumerate(ranges)
        if math.isfinite(r) and r <= 5.0
    ]
    np.testing.assert_allclose(
        hit_points(ranges, -1.0, 0.01, STILL, 5.0), np.array(expected).reshape(-1, 2), atol=1e-12
    )


@pytest.mark.parametrize("apart", [1, 4])
@pytest.mark.parametrize("seed", range(5))
def test_normals_are_the_plain_ones(seed, apart):
    points = hit_points(ragged_ranges(np.random.default_rng(seed)), -1.0, 0.01, STILL, np.inf)
    normals = np.empty_like(points)
    write_normals(points, apart, 0.5, normals)
    np.testing.assert_allclose(normals, reference.facing_normals(points, apart, 0.5), atol=1e-12)
    np.testing.assert_allclose(np.hypot(*normals.T), 1.0)
    assert (np.einsum("ij,ij->i", normals, points) <= 0.0).all()


def test_nothing_hit_is_nothing():
    assert hit_points(np.array([np.nan, np.inf]), 0.0, 0.1, STILL, np.inf).shape == (0, 2)
    write_normals(np.zeros((0, 2)), 1, 0.5, np.zeros((0, 2)))


@pytest.mark.parametrize(("at_least", "step"), [(100, 1), (20, 1), (12, 3), (1, 36)])
def test_hits_of_several_scans_are_placed_one_by_one(at_least, step):
    generator = np.random.default_rng(0)
    points, normals = generator.normal(size=(2, 30, 2)).astype(np.float32)
    offsets, poses = np.array([0, 10, 10, 17, 30]), generator.normal(size=(4, 3))
    chosen, frame = np.array([3, 1, 0, 3]), SE2.from_array(poses[2])
    expected_points, expected_normals = [], []
    for k in chosen:
        pose = frame.inverse() @ SE2.from_array(poses[k])
        expected_points.append(pose.apply(points[offsets[k] : offsets[k + 1]]))
        expected_normals.append(SE2(0.0, 0.0, pose.theta).apply(normals[offsets[k] : offsets[k + 1]]))
    placed, facing = place_hits(points, normals, offsets, chosen, poses, 2, at_least)
    np.testing.assert_allclose(placed, np.vstack(expected_points)[::step], atol=1e-6)
    np.testing.assert_allclose(facing, np.vstack(expected_normals)[::step], atol=1e-6)
