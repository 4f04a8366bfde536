import itertools
import math

import numpy as np
import pytest

from tbmslam.kernels.lattice import Lattice
from tbmslam.kernels.surfel_alignment import align, linearise, pair_up
from tbmslam.kernels.surfel_search import search
from tbmslam.kernels.surfels import CELLS, Surfels, add_hits, claim_tiles, extent, fit_surfel, slot_of
from tests import reference

RESOLUTION = 0.1
LIMITS = (0.02, 0.03, 0.05, 8.0)
LATTICE = Lattice(RESOLUTION, -60, -60)


def room_walls(generator, count=3000):
    """Hits on the four walls of a 6 m x 4 m room and on a thin post, with 1 cm noise."""
    side = generator.integers(0, 4, count)
    t = generator.uniform(-1.0, 1.0, count)
    x = np.select([side == 0, side == 1], [3.0, -3.0], 3.0 * t)
    y = np.select([side == 2, side == 3], [2.0, -2.0], 2.0 * t)
    post = np.array([1.0, 0.5]) + generator.normal(0.0, 0.005, (50, 2))
    return np.vstack((np.column_stack((x, y)) + generator.normal(0.0, 0.01, (count, 2)), post))


def facing_origin(points):
    """Normals of surfaces that all face a laser at the origin."""
    return -points / np.maximum(np.hypot(*points.T), 1e-9)[:, None]


def surfels_of(points, normals=None):
    """Return a surfel map's arrays with points inserted in several parts."""
    normals = facing_origin(points) if normals is None else normals
    surfels = Surfels(
        tiles=np.zeros((2, 30, 30), dtype=np.int32),
        moments=np.zeros((CELLS * (2 * 30 * 30 + 1), 6), dtype=np.float32),
        fits=np.zeros((CELLS * (2 * 30 * 30 + 1), 8), dtype=np.float32),
        lattice=LATTICE,
        limits=LIMITS,
    )
    used = 1
    for part in np.array_split(np.arange(len(points)), 7):
        used = claim_tiles(surfels.tiles, LATTICE, used, points[part], normals[part])
        add_hits(surfels, points[part], normals[part])
    assert used == surfels.tiles.max() + 1
    assert not surfels.moments[:CELLS].any()
    return surfels


NOTHING = Surfels(
    np.zeros((2, 30, 30), dtype=np.int32),
    np.zeros((CELLS, 6), dtype=np.float32),
    np.zeros((CELLS, 8), dtype=np.float32),
    lattice=LATTICE,
    limits=LIMITS,
)


def test_surfels_are_the_plain_fit():
    points = room_walls(np.random.default_rng(0), 400)
    front = np.full((len(points), 2), 1.0)
    surfels = surfels_of(points, front)
    assert not surfels.tiles[0].any()
    for row, col in np.random.default_rng(1).integers(15, 105, (400, 2)):
        cell = np.array([row + LATTICE.first_row, col + LATTICE.first_col])
        expected = reference.surfel(points, cell, RESOLUTION, *LIMITS)
        slot = slot_of(surfels.tiles, 1, row, col)
        if surfels.fits[slot, 5] < 0.0:
            fit_surfel(surfels, 1, row, col)
        if expected is None:
            assert surfels.fits[slot, 5] == 0.0
            continue
        mean, information, weight = expected
        x, y, xx, xy, yy, fitted_weight = surfels.fits[slot, :6]
        np.testing.assert_allclose((x, y), mean, atol=1e-5)
        fitted = [[xx, xy], [xy, yy]]
        np.testing.assert_allclose(fitted, information, rtol=2e-2, atol=2.0)
        assert fitted_weight == pytest.approx(weight, rel=1e-3)


def linearised(surfels, points, normals, pose, tolerance):
    """Return the cost and the matched share, the Hessian and the gradient of a scan at a pose."""
    pairs, hessian, gradient = np.empty((len(points), 8)), np.zeros((3, 3)), np.zeros(3)
    count = pair_up(surfels, points, normals, 1, pose, pairs)
    return *linearise(pairs[:count], 1.0 / len(points), pose, tolerance, hessian, gradient), hessian, gradient


def test_gradient_and_curvature_are_those_of_the_cost():
    generator = np.random.default_rng(2)
    surfels = surfels_of(room_walls(generator))
    points = room_walls(generator, 300)

    def cost(pose):
        return linearised(surfels, points, facing_origin(points), pose, 50.0)[0]

    pose = (0.004, -0.003, 0.001)
    _, _, hessian, gradient = linearised(surfels, points, facing_origin(points), pose, 50.0)
    step = 1e-6
    for axis in range(3):
        ahead, behind = list(pose), list(pose)
        ahead[axis] += step
        behind[axis] -= step
        slope = (cost(tuple(ahead)) - cost(tuple(behind))) / (2 * step)
        assert 2.0 * gradient[axis] == pytest.approx(slope, rel=0.05, abs=0.02 * abs(hessian[axis, axis]) * 0.01)
    assert np.linalg.eigvalsh(hessian).min() > 0.0


def aligned(points, guess, deviation=np.inf, surfels=None):
    deviations, say, tolerances = np.full(3, deviation), float(len(points)), np.array([8.0, 3.0])
    return align(surfels, points, facing_origin(points), 1, guess, deviations, say, tolerances, 10)


def test_a_scan_finds_its_place_to_millimetres():
    generator = np.random.default_rng(4)
    surfels = surfels_of(room_walls(generator))
    pose, hessian, matched, _ = aligned(room_walls(generator, 400), (0.06, -0.05, 0.02), surfels=surfels)
    assert math.hypot(pose[0], pose[1]) < 0.003
    assert abs(pose[2]) < 0.002
    assert matched > 0.8
    assert hessian.shape == (3, 3)


def test_along_a_corridor_the_guess_stays():
    generator = np.random.default_rng(5)

    def walls(count):
        hits = np.column_stack(
            (generator.uniform(-4.0, 4.0, count), np.where(generator.random(count) < 0.5, -1.0, 1.0))
        )
        return hits + generator.normal(0.0, 0.005, (count, 2))

    surfels, scan = surfels_of(walls(3000)), walls(1000)
    scan = scan[np.abs(scan[:, 0]) < 2.5][:300]
    pose, hessian, _, _ = aligned(scan, (0.3, 0.04, 0.01), deviation=0.05, surfels=surfels)
    assert pose[0] == pytest.approx(0.3, abs=0.02)
    assert pose[1] == pytest.approx(0.0, abs=0.005)
    assert hessian[0, 0] < 0.02 * hessian[1, 1]


def test_few_of_many_points_find_the_place_as_well():
    generator = np.random.default_rng(4)
    surfels = surfels_of(room_walls(generator))
    points = room_walls(generator, 1200)
    deviations, tolerances = np.full(3, np.inf), np.array([8.0, 3.0])
    normals = facing_origin(points)
    every, some = (
        align(surfels, points, normals, n, (0.06, -0.05, 0.02), deviations, 40.0, tolerances, 10) for n in (1, 3)
    )
    assert some[0] == pytest.approx(every[0], abs=0.003)
    assert some[2] == pytest.approx(every[2], rel=0.05)
    np.testing.assert_allclose(some[1], every[1], rtol=0.3, atol=0.05 * np.abs(every[1]).max())


def test_nothing_known_leaves_the_guess():
    pose, _, matched, cost = aligned(np.ones((5, 2)), (1.0, 2.0, 0.5), deviation=1.0, surfels=NOTHING)
    assert pose == pytest.approx((1.0, 2.0, 0.5))
    assert (matched, cost) == (0.0, 0.0)


def test_search_is_trying_every_pose():
    generator = np.random.default_rng(6)
    surfels = surfels_of(room_walls(generator))
    turns = np.arange(-0.3, 0.31, 0.1)
    scan = room_walls(generator, 60)
    normals, guess, costs = facing_origin(scan), (0.213, -0.134, 0.151), (0.2, 0.05)
    found = search(surfels, scan, normals, guess, 3, turns, 8.0, costs)
    scores = {}
    for turn, row, col in itertools.product(turns, range(-3, 4), range(-3, 4)):
        pose = (guess[0] + col * RESOLUTION, guess[1] + row * RESOLUTION, guess[2] + turn)
        away = costs[0] * RESOLUTION * math.hypot(row, col) + costs[1] * abs(turn)
        matched = linearised(surfels, scan, normals, pose, 8.0)[1]
        scores[pose] = matched - away
    assert found == pytest.approx(max(scores, key=scores.get))


def test_search_finds_a_far_place():
    generator = np.random.default_rng(6)
    surfels = surfels_of(room_walls(generator))
    turns = np.arange(-1.0, 1.01, 0.03)
    scan = room_walls(generator, 150)
    found = search(surfels, scan, facing_origin(scan), (0.4, -0.3, 0.75), 5, turns, 8.0, (0.0, 0.0))
    assert found == pytest.approx((0.0, 0.0, 0.0), abs=0.09)


def test_search_takes_the_nearest_of_equals():
    generator = np.random.default_rng(7)
    wall = np.column_stack((generator.uniform(-5.0, 5.0, 3000), generator.normal(0.0, 0.01, 3000)))
    scan = wall[np.abs(wall[:, 0]) < 2.0][:150]
    normals = np.full((len(scan), 2), 1.0)
    surfels = surfels_of(wall, np.full((len(wall), 2), 1.0))
    near = search(surfels, scan, normals, (0.05, 0.0, 0.0), 10, np.zeros(1), 8.0, (0.2, 0.0))
    assert near[0] == pytest.approx(0.05)


def test_the_far_face_of_a_thin_wall_is_another_surface():
    generator = np.random.default_rng(8)
    along = generator.uniform(-4.0, 4.0, 4000)
    near_face = np.column_stack((along, 1.0 + generator.normal(0.0, 0.005, 4000)))
    far_face = near_face + np.array([0.0, 0.12])
    towards, away = np.full((4000, 2), [0.0, -1.0]), np.full((4000, 2), [0.0, 1.0])
    surfels = surfels_of(np.vstack((near_face, far_face)), np.vstack((towards, away)))
    for face, normals in ((near_face, towards), (far_face, away)):
        tolerances = np.array([8.0, 3.0])
        pose, _, matched, _ = align(
            surfels, face[:300], normals[:300], 1, (0.0, 0.05, 0.0), np.ones(3), 300.0, tolerances, 10
        )
        assert pose[1] == pytest.approx(0.0, abs=0.003)
        assert matched > 0.9


def test_surfaces_are_fitted_anew_where_hits_came_after():
    points = room_walls(np.random.default_rng(9), 500)
    fitted, late = surfels_of(points[:300]), surfels_of(points)
    cells = list(itertools.product((0, 1), range(10, 110), range(10, 110)))
    for cell in cells:
        if slot_of(fitted.tiles, *cell) >= CELLS:
            fit_surfel(fitted, *cell)
    more = points[300:], facing_origin(points[300:])
    used = claim_tiles(fitted.tiles, LATTICE, int(fitted.tiles.max()) + 1, *more)
    add_hits(fitted, *more)
    assert used == late.tiles.max() + 1
    for cell in cells:
        mine, theirs = (one.fits[slot_of(one.tiles, *cell)] for one in (fitted, late))
        for one in (fitted, late):
            if one.fits[slot_of(one.tiles, *cell), 5] < 0.0:
                fit_surfel(one, *cell)
        assert mine[5] >= 0.0
        np.testing.assert_allclose(mine, theirs, rtol=1e-4, atol=1e-4)


def test_the_extent_is_that_of_the_points(generator):
    points = generator.normal(size=(20, 2))
    expected = (*np.sort(points[:, 0])[[0, -1]], *np.sort(points[:, 1])[[0, -1]])
    assert extent(points) == expected
