import itertools
import math

import numpy as np
import pytest

from tbmslam.kernels.rays.hits import hits_of_scan
from tbmslam.kernels.surfels.determined import prior_information
from tbmslam.kernels.surfels.surfel_alignment import NOWHERE, align, composed, linearise, pair_up, place_scan
from tbmslam.kernels.surfels.surfels import (
    CELLS,
    FACING,
    Surfels,
    cells_of,
    extent,
    fit_surfel,
    insert_hits,
    layer_of,
    slot_of,
)
from tests import reference
from tests.tbmslam.kernels.surfels.surfel_rooms import (
    LATTICE,
    LIMITS,
    RESOLUTION,
    facing_origin,
    inserted,
    room_walls,
    surfels_of,
)

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


SPAN = 0.001
"""So short a correlation length that every hit of these walls counts as one."""


def paired(surfels, points, normals, pose, every=1, span=SPAN):
    """Return the pairs (8, M) of a scan at a pose, and how many independent hits it counts for."""
    pairs = np.empty((8, len(points) + 1))
    count, independent = pair_up(surfels, points, normals, every, span, pose, pairs)
    return pairs[:, :count], independent


def linearised(surfels, points, normals, pose, tolerance):
    """Return how many independent hits match, the Hessian and the gradient of a scan at a pose."""
    pairs, _ = paired(surfels, points, normals, pose)
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    matched = linearise(np.ascontiguousarray(pairs), pairs.shape[1], pose, tolerance, hessian, gradient)
    return matched, hessian, gradient


def test_the_normal_equations_are_those_of_the_slow_twin():
    generator = np.random.default_rng(2)
    surfels = surfels_of(room_walls(generator))
    points, pose = room_walls(generator, 301), (0.04, -0.03, 0.01)
    pairs, _ = paired(surfels, points, facing_origin(points), pose)
    matched, hessian, gradient = linearised(surfels, points, facing_origin(points), pose, 4.0)
    slow = reference.normal_equations(pairs, pose, 4.0)
    assert matched == pytest.approx(slow[0], rel=1e-10)
    np.testing.assert_allclose(hessian, slow[1], rtol=1e-9, atol=1e-9 * np.abs(slow[1]).max())
    np.testing.assert_allclose(gradient, slow[2], rtol=1e-9, atol=1e-9 * np.abs(slow[2]).max())


def test_gradient_and_curvature_are_those_of_the_cost():
    generator = np.random.default_rng(2)
    surfels = surfels_of(room_walls(generator))
    points = room_walls(generator, 300)
    pose = (0.004, -0.003, 0.001)
    pairs, _ = paired(surfels, points, facing_origin(points), pose)
    _, hessian, gradient = linearised(surfels, points, facing_origin(points), pose, 50.0)
    step = 1e-6
    for axis in range(3):
        ahead, behind = list(pose), list(pose)
        ahead[axis] += step
        behind[axis] -= step
        costs = (reference.robust_cost(pairs, there, 50.0) for there in (ahead, behind))
        slope = (next(costs) - next(costs)) / (2 * step)
        assert 2.0 * gradient[axis] == pytest.approx(slope, rel=1e-3, abs=1e-6 * abs(hessian[axis, axis]))
    assert np.linalg.eigvalsh(hessian).min() > 0.0


@pytest.mark.parametrize("every", [1, 2, 5])
def test_a_scan_counts_for_the_length_of_wall_that_it_sees(every):
    along = np.linspace(-2.0, 2.0, 401)
    wall = np.column_stack((along, np.ones(401)))
    lone = np.array([[-5.0, 5.0], [5.0, -5.0], [5.0, 5.0]])
    _, of_wall = paired(NOTHING, wall, facing_origin(wall), (0.0, 0.0, 0.0), every, span=0.25)
    _, of_lone = paired(NOTHING, lone, facing_origin(lone), (0.0, 0.0, 0.0), 1, span=0.25)
    assert of_wall == pytest.approx(4.0 / 0.25 + 1.0, abs=0.5)
    assert of_lone == 3.0


BROAD = 1e-12 * np.eye(3)
"""A prior that says nothing."""


def aligned(points, start, deviation=np.inf, surfels=None, mean=None, freedom=1e9, enough=10_000, known=NOWHERE):
    prior = np.eye(3) * deviation**-2.0 if np.isfinite(deviation) else BROAD
    search_for = freedom, SPAN, np.inf, np.array([8.0, 3.0]), enough, 10
    hessian = np.empty((3, 3))
    x, y, theta, *fit = align(
        plain(surfels), points, facing_origin(points), start, mean or start, prior, search_for, known, hessian
    )
    return (x, y, theta), hessian, *fit


def plain(surfels):
    """Return surfels as the plain tuples that kernels take."""
    return (*surfels[:3], tuple(surfels.lattice), surfels.limits)


def test_a_scan_finds_its_place_to_millimetres():
    generator = np.random.default_rng(4)
    surfels = surfels_of(room_walls(generator))
    pose, hessian, matched, *_ = aligned(room_walls(generator, 400), (0.06, -0.05, 0.02), surfels=surfels)
    assert math.hypot(pose[0], pose[1]) < 0.003
    assert abs(pose[2]) < 0.002
    assert matched > 0.8
    assert hessian.shape == (3, 3)


def test_along_a_corridor_the_prior_stays():
    """Over seeds: now and then the normals of noisy walls tell a little of the way along them."""
    slid = []
    for seed in range(5, 10):
        generator = np.random.default_rng(seed)
        surfels, scan = surfels_of(corridor(generator, 3000)), corridor(generator, 1000)
        scan = scan[np.abs(scan[:, 0]) < 2.5][:300]
        pose, hessian, *_ = aligned(scan, (0.3, 0.04, 0.01), deviation=0.05, surfels=surfels)
        slid.append(abs(pose[0] - 0.3))
        assert pose[1] == pytest.approx(0.0, abs=0.002)
        assert hessian[0, 0] < 0.02 * hessian[1, 1]
    assert np.median(slid) < 0.01
    assert max(slid) < 0.06


def corridor(generator, count):
    """Hits on two long walls two metres apart, with 5 mm noise."""
    hits = np.column_stack((generator.uniform(-4.0, 4.0, count), np.where(generator.random(count) < 0.5, -1.0, 1.0)))
    return hits + generator.normal(0.0, 0.005, (count, 2))


def test_few_of_many_points_find_the_place_as_well():
    generator = np.random.default_rng(4)
    surfels = surfels_of(room_walls(generator))
    points = room_walls(generator, 1200)
    start = (0.06, -0.05, 0.02)
    every, some = (aligned(points, start, surfels=surfels, enough=enough) for enough in (1200, 400))
    assert some[0] == pytest.approx(every[0], abs=0.003)
    assert some[2] == pytest.approx(every[2], rel=0.05)
    # A third of the hits, with most of what all of them know: a hundred hits of a scan tell little more than fifty.
    assert 0.6 < some[1][2, 2] / every[1][2, 2] < 1.0


def test_nothing_known_leaves_the_guess():
    points = np.array([[1.0, 1.0], [1.0, 2.0], [1.0, 3.0]])
    pose, hessian, matched, _, surprise = aligned(points, (1.0, 2.0, 0.5), deviation=1.0, surfels=NOTHING)
    assert pose == pytest.approx((1.0, 2.0, 0.5))
    assert (matched, surprise) == (0.0, 0.0)
    assert not hessian.any()


def test_a_prior_far_off_is_overruled_and_one_nearby_is_not():
    """Student's t distribution: an odometry ten deviations off has slipped."""
    generator = np.random.default_rng(11)
    surfels, scan = surfels_of(room_walls(generator)), room_walls(generator, 40)
    for off, freedom, kept in ((0.2, 4.0, 0.1), (0.2, 1e9, 0.5)):
        pose, _, _, _, surprise = aligned(scan, (0.0, 0.0, 0.0), 0.002, surfels, mean=(off, 0.0, 0.0), freedom=freedom)
        assert surprise == pytest.approx(((pose[0] - off) / 0.002) ** 2, rel=0.2)
        if freedom < 10.0:
            assert abs(pose[0]) < kept * off
        else:
            assert abs(pose[0]) > kept * off


@pytest.mark.parametrize("start", [(0.05, -0.04, 0.02), (-0.03, 0.06, -0.01)])
def test_a_search_ends_at_a_known_pose_that_it_comes_to(start):
    generator = np.random.default_rng(15)
    surfels, scan = surfels_of(room_walls(generator)), room_walls(generator, 120)
    there, _, matched, *_ = aligned(scan, (0.0, 0.0, 0.0), surfels=surfels)
    near = (there[0] + 0.0004, there[1] - 0.0004, there[2] + 0.0002)
    ended, _, share, *_ = aligned(scan, start, surfels=surfels, known=near)
    assert ended == near
    assert share == -1.0
    beside = (there[0] + 0.004, there[1], there[2])
    ended, _, share, *_ = aligned(scan, start, surfels=surfels, known=beside)
    assert ended == pytest.approx(there, abs=4e-4)
    assert share == pytest.approx(matched, abs=0.01)


@pytest.mark.parametrize(("turn", "heading"), [(0.3, -0.3), (-math.pi, -3.1), (math.pi, 3.1)])
def test_placing_a_scan_is_aligning_its_hits(turn, heading):
    generator = np.random.default_rng(12)
    surfels = surfels_of(room_walls(generator))
    mount, deviations = (0.2, -0.1, turn), (0.05, 0.03, 0.02)
    angles = np.arange(181) * math.radians(2.0) - math.pi + 0.3
    robot = (-0.1, 0.2, heading)
    laser = composed(robot, mount)
    ranges = reference.ranges_in_box(laser, angles, 3.0, 2.0)
    beams = float(angles[0]), math.radians(2.0), (0.0, 0.0, 0.0), 40.0
    start = (robot[0] + 0.03, robot[1] - 0.02, robot[2] + 0.01)
    search_for = 4.0, 0.1, np.inf, np.array([8.0, 3.0]), 400, 10
    seen, hessian, same = np.empty((2, len(ranges), 2)), np.empty((3, 3)), np.empty((3, 3))
    placed, count = place_scan(
        plain(surfels), ranges, beams, start, start, deviations, mount, search_for, seen, hessian
    )
    hits, facing = hits_of_scan(ranges, *beams)
    information = prior_information(deviations, start[2], mount)
    there = composed(start, mount)
    twin = align(plain(surfels), hits, facing, there, there, information, search_for, NOWHERE, same)
    np.testing.assert_array_equal(seen[:, :count], [hits, facing])
    np.testing.assert_array_equal(hessian, same)
    assert placed == twin
    assert placed[:3] == pytest.approx(laser, abs=0.01)


def test_the_far_face_of_a_thin_wall_is_another_surface():
    generator = np.random.default_rng(8)
    along = generator.uniform(-4.0, 4.0, 4000)
    near_face = np.column_stack((along, 1.0 + generator.normal(0.0, 0.005, 4000)))
    far_face = near_face + np.array([0.0, 0.12])
    towards, away = np.full((4000, 2), [0.0, -1.0]), np.full((4000, 2), [0.0, 1.0])
    surfels = surfels_of(np.vstack((near_face, far_face)), np.vstack((towards, away)))
    for face, normals in ((near_face, towards), (far_face, away)):
        start, search_for = (0.0, 0.05, 0.0), (1e9, SPAN, np.inf, np.array([8.0, 3.0]), 1000, 10)
        _, y, _, matched, *_ = align(
            plain(surfels), face[:300], normals[:300], start, start, np.eye(3), search_for, NOWHERE, np.empty((3, 3))
        )
        assert y == pytest.approx(0.0, abs=0.003)
        assert matched > 0.9


def test_surfaces_are_fitted_anew_where_hits_came_after():
    points = room_walls(np.random.default_rng(9), 500)
    fitted, late = surfels_of(points[:300]), surfels_of(points)
    cells = list(itertools.product((0, 1), range(10, 110), range(10, 110)))
    for cell in cells:
        if slot_of(fitted.tiles, *cell) >= CELLS:
            fit_surfel(fitted, *cell)
    used = inserted(fitted, int(fitted.tiles.max()) + 1, points[300:], facing_origin(points[300:]))
    assert used == late.tiles.max() + 1
    for cell in cells:
        mine, theirs = (one.fits[slot_of(one.tiles, *cell)] for one in (fitted, late))
        for one in (fitted, late):
            if one.fits[slot_of(one.tiles, *cell), 5] < 0.0:
                fit_surfel(one, *cell)
        assert mine[5] >= 0.0
        np.testing.assert_allclose(mine, theirs, rtol=1e-4, atol=1e-4)


def test_hits_lie_in_the_cells_of_where_their_frame_is(generator):
    points, pose = generator.uniform(-5.0, 5.0, (50, 2)), (0.3, -0.2, 0.7)
    turn = np.array([[math.cos(0.7), -math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]])
    normals = facing_origin(points)
    cells, offsets = cells_of(points, normals, pose, LATTICE)
    lattice = (points @ turn.T + pose[:2]) / RESOLUTION
    np.testing.assert_array_equal(cells[:, 1::-1], np.floor(lattice).astype(int) + 60)
    np.testing.assert_array_equal(cells[:, 2], [layer_of(*normal) for normal in normals @ turn.T])
    np.testing.assert_allclose(offsets, lattice - np.floor(lattice) - 0.5, atol=1e-9)


@pytest.mark.parametrize(("x", "used", "found"), [(5.85, 2, -1), (1.0, 10**6, 10**6 + 1)])
def test_hits_at_the_border_and_hits_without_room_are_not_added(x, used, found):
    surfels = surfels_of(np.array([[0.05, 0.05]]))
    moments, fits = surfels.moments.copy(), surfels.fits.copy()
    points = np.array([[0.05, 0.05], [x, 0.25]])
    assert insert_hits(surfels, used, points, facing_origin(points), (0.0, 0.0, 0.0)) == found
    np.testing.assert_array_equal(surfels.moments, moments)
    np.testing.assert_array_equal(surfels.fits, fits)


def test_memory_of_new_tiles_may_hold_anything(generator):
    points, nowhere = room_walls(generator, 200), np.zeros((0, 2))
    cleared, dirty = surfels_of(nowhere), surfels_of(nowhere)
    dirty.moments[CELLS:], dirty.fits[CELLS:] = 7.0, 7.0
    for surfels in (cleared, dirty):
        used = insert_hits(surfels, 1, points[:100], facing_origin(points[:100]), (0.0, 0.0, 0.0))
        used = insert_hits(surfels, used, points[100:], facing_origin(points[100:]), (0.0, 0.0, 0.0))
    np.testing.assert_array_equal(dirty.moments[: CELLS * used], cleared.moments[: CELLS * used])
    np.testing.assert_array_equal(dirty.fits[: CELLS * used], cleared.fits[: CELLS * used])
    assert (dirty.moments[CELLS * used :] == 7.0).all()


def test_the_extent_is_that_of_the_points(generator):
    points = generator.normal(size=(20, 2))
    expected = (*np.sort(points[:, 0])[[0, -1]], *np.sort(points[:, 1])[[0, -1]])
    assert extent(points) == expected


def test_layers_part_square_to_the_way_they_face():
    middle = math.atan2(FACING[1], FACING[0])
    for turn, layer in itertools.product((0.01, 1.0, 1.56), (0, 1)):
        for side in (1.0, -1.0):
            angle = middle + side * (turn if layer == 1 else math.pi - turn)
            assert layer_of(math.cos(angle), math.sin(angle)) == layer


def test_a_pose_is_where_scan_and_prior_balance():
    """The mode of Student's t prior times the scan's likelihood: their slopes cancel."""
    generator = np.random.default_rng(14)
    surfels, scan, freedom, deviation = surfels_of(room_walls(generator)), room_walls(generator, 60), 4.0, 0.002
    mean = (0.02, -0.015, 0.01)
    pose, hessian, *_ = aligned(scan, (0.0, 0.0, 0.0), deviation, surfels, mean=mean, freedom=freedom)
    _, of_scan, gradient = linearised(surfels, scan, facing_origin(scan), pose, 3.0)
    error = np.subtract(pose, mean) / deviation
    pull = (freedom + 3.0) / (freedom + error @ error) * error / deviation
    np.testing.assert_allclose(gradient * hessian[0, 0] / of_scan[0, 0], -pull, atol=0.02 * np.abs(pull).max())
    assert error @ error > 1.0
