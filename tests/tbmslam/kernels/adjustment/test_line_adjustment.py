import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.adjustment.line_adjustment import fit_lines, line_equations
from tbmslam.kernels.adjustment.pose_systems import MotionSystem, PoseSystem, eliminated, times
from tbmslam.kernels.adjustment.wall_pieces import Sightings

LIMITS = np.array([4.0, 0.05, 0.03])
ENOUGH, DEVIATION, WIDTH = 6.0, 0.03, 2.0


def moments_of(points):
    x, y = points.T
    return [len(x), x.sum(), y.sum(), (x * x).sum(), (x * y).sum(), (y * y).sum()]


class ThreeLines:
    """Three lines seen from three poses each, with noise: the hits one by one, and their moments."""

    def __init__(self, generator):
        self.poses = np.column_stack((generator.uniform(-1.0, 1.0, (4, 2)), generator.uniform(-3.0, 3.0, 4)))
        self.hits, self.observers, moments, begins = [], [], [], [0]
        for angle, middle in ((0.2, (2.0, 1.0)), (1.9, (-1.0, 2.0)), (2.8, (0.0, -3.0))):
            for observer in sorted(generator.choice(4, 3, replace=False)):
                count = int(generator.integers(3, 9))
                along, off = generator.uniform(-0.25, 0.25, count), generator.normal(0.0, 0.02, count)
                hits = np.array(middle) + np.outer(along, (math.cos(angle), math.sin(angle)))
                hits += np.outer(off, (-math.sin(angle), math.cos(angle)))
                local = SE2(*self.poses[observer]).inverse().apply(hits)
                self.hits.append(local)
                self.observers.append(observer)
                moments.append(moments_of(hits - self.poses[observer, :2]))
            begins.append(len(moments))
        self.moments, self.observers, self.begins = np.array(moments), np.array(self.observers), np.array(begins)

    def placed(self, o):
        return SE2(*self.poses[self.observers[o]]).apply(self.hits[o])

    def weight(self, o):
        return 1.0 / (1.0 + len(self.hits[o]) / ENOUGH)


@pytest.fixture
def seen(generator):
    return ThreeLines(generator)


def lines_of(seen, limits=LIMITS):
    return fit_lines(sightings_of(seen, np.repeat(np.arange(3), np.diff(seen.begins))), seen.poses, ENOUGH, limits)


def sightings_of(seen, pieces):
    return Sightings(len(pieces), int(pieces.max()) + 1, seen.moments, seen.observers, pieces)


def equations_of(seen, lines):
    return line_equations(seen.moments, seen.observers, seen.begins, lines, seen.poses, ENOUGH, DEVIATION, WIDTH)


def product_of(blocks, lines, changes):
    """Return the curvature times changes where no motion is known."""
    return times(
        PoseSystem(blocks, lines, MotionSystem(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3, 3)))), changes
    )


def test_lines_are_the_principal_axes_of_the_weighed_hits(seen):
    lines = lines_of(seen)
    for piece in range(3):
        own = range(seen.begins[piece], seen.begins[piece + 1])
        points = np.vstack([seen.placed(o) for o in own])
        weights = np.concatenate([np.full(len(seen.hits[o]), seen.weight(o)) for o in own])
        middle = np.average(points, axis=0, weights=weights)
        values, axes = np.linalg.eigh(np.cov(points.T, aweights=weights, ddof=0))
        np.testing.assert_allclose(lines[piece, :2], middle, atol=1e-9)
        assert abs(lines[piece, 2:4] @ axes[:, 1]) == pytest.approx(1.0, abs=1e-9)
        assert lines[piece, 4] == pytest.approx(math.sqrt(3.0 * values[1]), abs=1e-9)


@pytest.mark.parametrize("limits", [(1000.0, 0.05, 0.03), (4.0, 0.001, 0.03), (4.0, 0.05, 10.0)])
def test_what_is_too_little_too_thick_or_too_short_is_no_line(seen, limits):
    np.testing.assert_array_equal(lines_of(seen, np.array(limits)), 0.0)


def test_what_one_stretch_saw_alone_is_no_line(seen):
    alone = sightings_of(seen, np.arange(len(seen.observers)))
    np.testing.assert_array_equal(fit_lines(alone, seen.poses, ENOUGH, LIMITS), np.zeros((len(seen.observers), 5)))


def test_the_order_of_sightings_and_spare_room_mean_nothing(seen, generator):
    order, pieces = generator.permutation(len(seen.observers)), np.repeat(np.arange(3), np.diff(seen.begins))
    spare = [np.concatenate((one[order], one[:4])) for one in (seen.moments, seen.observers, pieces)]
    mixed = fit_lines(Sightings(len(order), 3, *spare), seen.poses, ENOUGH, LIMITS)
    np.testing.assert_allclose(mixed, lines_of(seen), atol=1e-12)


def plain_equations(seen, lines):
    """Return curvature (12, 12) and gradient (12,) with the lines eliminated, hit by hit."""
    size = 12 + 2 * len(lines)
    curvature, gradient = np.zeros((size, size)), np.zeros(size)
    for piece, (px, py, lx, ly, _) in enumerate(lines):
        normal, line = np.array([-ly, lx]), 12 + 2 * piece
        curvature[[line, line + 1], [line, line + 1]] += 1e-6
        for o in range(seen.begins[piece], seen.begins[piece + 1]):
            pose, placed = seen.poses[seen.observers[o]], seen.placed(o)
            distances = (placed - (px, py)) @ normal
            doubt = 1.0 + (distances.mean() / (WIDTH * DEVIATION)) ** 2
            for point, distance in zip(placed, distances, strict=True):
                arm = point - pose[:2]
                slope = np.zeros(size)
                at = 3 * seen.observers[o]
                slope[at : at + 3] = [*normal, normal @ [-arm[1], arm[0]]]
                slope[line : line + 2] = (point - (px, py)) @ [lx, ly], -1.0
                weight = seen.weight(o) / doubt / DEVIATION**2
                curvature += weight * np.outer(slope, slope)
                gradient += weight * slope * distance
    own, lines_own, both = curvature[:12, :12], curvature[12:, 12:], curvature[:12, 12:]
    return own, own - both @ np.linalg.solve(lines_own, both.T), (
        gradient[:12] - both @ np.linalg.solve(lines_own, gradient[12:])
    )  # fmt: skip


def test_the_equations_are_those_of_all_hits_with_the_lines_eliminated(seen, generator):
    lines = lines_of(seen)
    # Off the best line, so that sightings lose their say and the lines have something to turn to.
    lines[:, :2] += generator.normal(0.0, 0.02, (3, 2))
    blocks, system, gradient = equations_of(seen, lines)
    own, curvature, expected = plain_equations(seen, lines)
    scale = np.abs(own).max()
    np.testing.assert_allclose(gradient.ravel(), expected, atol=1e-9 * scale)
    taken = eliminated(system, 4)
    for k in range(4):
        some = slice(3 * k, 3 * k + 3)
        np.testing.assert_allclose(blocks[k], own[some, some], atol=1e-9 * scale)
        np.testing.assert_allclose(blocks[k] - taken[k], curvature[some, some], atol=1e-9 * scale)
    changes = generator.normal(size=(4, 3))
    product = product_of(blocks, system, changes)
    np.testing.assert_allclose(product.ravel(), curvature @ changes.ravel(), atol=1e-9 * scale)


def test_moving_everything_alike_changes_no_distance(seen):
    blocks, system, gradient = equations_of(seen, lines_of(seen))
    shift = np.tile([0.3, -0.2, 0.0], (4, 1))
    turn = np.column_stack((-seen.poses[:, 1], seen.poses[:, 0], np.ones(4)))
    scale = np.abs(blocks).max()
    for change in (shift, turn):
        product = product_of(blocks, system, change)
        np.testing.assert_allclose(product, 0.0, atol=1e-6 * scale)
        assert abs((gradient * change).sum()) < 1e-6 * scale


def test_pieces_that_are_no_lines_say_nothing(seen):
    blocks, system, gradient = equations_of(seen, np.zeros((3, 5)))
    assert not any(one.any() for one in (blocks, system.couplings, system.inverses, gradient))
    assert not product_of(blocks, system, np.ones((4, 3))).any()
    assert not eliminated(system, 4).any()
