"""What stands where earlier scans saw through, against a plain twin."""

import math

import numpy as np

from tbmslam.kernels.seen_space import are_seen_through, seen_distances, stands_in_seen_space, still_hits
from tbmslam.se2 import SE2


def plain_sector(x, y, directions):
    """Take a direction by octants, in each of which the arc tangent is nearly z (pi / 4 + 0.273 (1 - |z|))."""
    octant, rest = divmod(math.atan2(y, x) % (2.0 * math.pi), 0.25 * math.pi)
    z = math.tan(rest if octant % 2 == 0 else 0.25 * math.pi - rest)
    angle = z * (0.25 * math.pi + 0.273 * (1.0 - z))
    assert abs(angle - math.atan(z)) < 0.005
    angle = 0.25 * math.pi * octant + (angle if octant % 2 == 0 else 0.25 * math.pi - angle)
    return min(int(angle / (2.0 * math.pi) * directions), directions - 1)


def plain_seen(points, directions):
    met = [[] for _ in range(directions)]
    for x, y in points:
        met[plain_sector(x, y, directions)].append(math.hypot(x, y))
    around = [[met[(k + d) % directions] for d in (-1, 0, 1)] for k in range(directions)]
    return [min(min(one) for one in three) if all(three) else 0.0 for three in around]


def test_seen_distances_are_those_of_the_twin():
    rng = np.random.default_rng(4)
    for number in (0, 1, 30, 400):
        points = rng.normal(0.0, 3.0, (number, 2))
        np.testing.assert_allclose(seen_distances(points, 36), plain_seen(points, 36))


def test_points_stand_in_seen_space_where_the_twin_says_so():
    rng = np.random.default_rng(5)
    points, lasers = rng.normal(0.0, 2.0, (200, 2)), rng.normal(0.0, 1.0, (3, 3))
    seen = np.abs(rng.normal(2.0, 1.0, (3, 36)))
    pose = SE2(0.5, -0.3, 2.0)
    expected = []
    for point in pose.apply(points):
        there = [SE2.from_array(laser).inverse().apply(point[None])[0] for laser in lasers]
        expected.append(any(seen[k][plain_sector(x, y, 36)] > math.hypot(x, y) + 0.1 for k, (x, y) in enumerate(there)))
    assert stands_in_seen_space(points, pose, lasers, seen, 0.1).tolist() == expected
    assert 20 < sum(expected) < 180
    kept, normals = still_hits(points, -points, pose, lasers, seen, 0.1)
    np.testing.assert_array_equal(kept, points[~np.array(expected)])
    np.testing.assert_array_equal(normals, -kept)


def test_no_laser_has_seen_nothing():
    points = np.ones((4, 2))
    assert not stands_in_seen_space(points, SE2.identity(), np.zeros((0, 3)), np.zeros((0, 36)), 0.1).any()


def test_one_scan_sees_through_a_place_and_all_around_it_where_the_twin_says_so():
    rng = np.random.default_rng(6)
    points, lasers = rng.normal(0.0, 2.0, (200, 2)), rng.normal(0.0, 1.0, (4, 3))
    around = np.array([(0.0, 0.0), (0.2, 0.0), (0.0, -0.3)])
    seen = [np.abs(rng.normal(2.0, 1.0, directions)) for directions in (36, 1, 60, 36)]

    def sees_through(laser, own, place):
        x, y = SE2.from_array(laser).inverse().apply(place[None])[0]
        return own[plain_sector(x, y, len(own))] > math.hypot(x, y) + 0.1

    expected = [
        any(all(sees_through(*scan, point + away) for away in around) for scan in zip(lasers, seen, strict=True))
        for point in points
    ]
    begins = np.cumsum([0, *map(len, seen)])
    assert are_seen_through(points, around, lasers, np.concatenate(seen), begins, 0.1).tolist() == expected
    assert 20 < sum(expected) < 180
    nobody = are_seen_through(points, around, lasers[:0], np.zeros(0), begins[:1], 0.1)
    assert not nobody.any()
