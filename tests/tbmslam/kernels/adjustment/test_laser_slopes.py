import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.adjustment.laser_slopes import (
    NUMBERS,
    OFFSET,
    SCALE,
    SWEEP,
    corrected_hits,
    laser_equations,
    single_scan_hits,
)
from tbmslam.map.keyframes import Keyframes
from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig, WallLines
from tbmslam.sensing.laser_scan import LaserScan

CONFIG = AdjustmentConfig(min_hits=4.0)
LIMITS = CONFIG.enough, CONFIG.deviation, CONFIG.robust_width
RATES = np.array([0.3, -0.2, 0.0, 0.5])


def room_scan(pose, generator, beams=150):
    """Return what a laser sees of a room of 6 by 4 m around the origin, through a door 2 m wide in a wall."""
    step = math.radians(240.0) / beams
    angles = pose.theta - 2.0 + step * np.arange(beams)
    cosine, sine = np.cos(angles), np.sin(angles)
    across = np.where(cosine > 0.0, 3.0 - pose.x, -3.0 - pose.x) / cosine
    up = np.where(sine > 0.0, 2.0 - pose.y, -2.0 - pose.y) / sine
    ranges = np.minimum(across, up)
    at = pose.y + ranges * sine
    ranges[(across < up) & (cosine > 0.0) & (np.abs(at) < 1.0)] = np.inf
    ranges[::17] = 1.0  # somebody's legs
    return LaserScan(0.0, -2.0, step, 0.1, 30.0, ranges + generator.normal(0.0, 0.01, beams), 0.0, SE2(1e-5, 0.0, 1e-5))


@pytest.fixture
def poses(generator):
    return np.column_stack((generator.uniform(-1.0, 1.0, (4, 2)), generator.uniform(-3.0, 3.0, 4)))


@pytest.fixture
def keyframes(poses, generator):
    scans = [room_scan(SE2(*pose), generator) for pose in poses]
    return Keyframes.from_scans(scans, [SE2(*pose) for pose in poses], [SE2.identity()] * 4)


def gathered(keyframes, chosen, most, max_range=30.0):
    scans = keyframes.ranges, keyframes.offsets, keyframes.beams, keyframes.beam_steps
    return single_scan_hits(*scans, np.array(chosen), most, (max_range, CONFIG.gap, CONFIG.bulge))


@pytest.mark.parametrize(("chosen", "most"), [((0, 1, 2, 3), 1000), ((1, 3), 60)])
def test_hits_of_scans_are_gathered_as_the_plain_answer_says(keyframes, chosen, most):
    hits, begins = gathered(keyframes, chosen, most, 3.5)
    expected, ends = [], [0]
    for k in chosen:
        scan = keyframes.scan(k)
        known, every = scan.hits(3.5), max(len(scan.ranges) // most, 1)
        those = np.flatnonzero(scan.ranges <= 3.5)
        assert 20 < len(those) < len(scan.ranges)
        for number, beam in enumerate(those):
            before, after = known.points[max(number - 1, 0)], known.points[min(number + 1, len(those) - 1)]
            (x, y), normal = known.points[number], known.normals[number]
            is_near = np.hypot(*(after - before)) <= CONFIG.gap
            if beam % every == 0 and is_near and abs(normal @ ((x, y) - before)) <= CONFIG.bulge:
                middle = (beam - (len(scan.ranges) - 1) / 2.0) * scan.angle_increment
                expected.append([math.hypot(x, y), math.atan2(y, x), middle, math.atan2(normal[1], normal[0])])
        ends.append(len(expected))
    np.testing.assert_allclose(hits, expected, atol=1e-9)
    np.testing.assert_array_equal(begins, ends)


def test_hits_bend_about_the_middle_of_the_fan(keyframes):
    hits, begins = gathered(keyframes, (0, 1, 2, 3), 1000)
    straight = corrected_hits(hits, begins, np.zeros(4), 0.0)
    bent = corrected_hits(hits, begins, np.array([0.02, 0.0, -0.01, 0.0]), 0.05)
    scales = np.repeat([0.02, 0.0, -0.01, 0.0], np.diff(begins))
    turn = scales * hits[:, 2]
    for k, own in enumerate(hits):
        direction = SE2(0.0, 0.0, own[1] + turn[k]).matrix()[:, 0]
        np.testing.assert_allclose(bent.walls[k, :2], (own[0] + 0.05) * direction[:2], atol=1e-5)
    turned = bent.walls[:, 2].astype(float) - straight.walls[:, 2] - turn
    np.testing.assert_allclose(np.remainder(turned + 1.0, 2.0 * math.pi), 1.0, atol=1e-5)
    assert (np.abs(bent.walls[:, 2]) <= np.float32(math.pi)).all()
    np.testing.assert_array_equal(bent.wall_begins, begins)
    assert len(bent.loose) == 0
    np.testing.assert_array_equal(bent.loose_begins, np.zeros(5))


def piece_of(raster, known, x, y, facing):
    """Return the piece of a hit by searching through the whole table."""
    key = (math.floor((y - raster.shift) / raster.cell) << 32) + math.floor((x - raster.shift) / raster.cell)
    number = dict(known.cells.tolist())[key]
    return known.numbers[number * raster.sectors + round(facing / (2.0 * math.pi) * raster.sectors) % raster.sectors]


def plain_equations(hits, angles, poses, seen):
    """Return the curvature and the gradient of poses, numbers and lines together, hit by hit."""
    first_line = 12 + NUMBERS
    size = first_line + 2 * len(seen.lines)
    curvature, gradient = np.zeros((size, size)), np.zeros(size)
    curvature[first_line:, first_line:] = 1e-6 * np.eye(size - first_line)
    met = {}
    for k in range(len(poses)):
        for i in range(hits.wall_begins[k], hits.wall_begins[k + 1]):
            point = SE2(*poses[k]).apply(hits.walls[i, :2].astype(float))
            line = seen.numbers[piece_of(seen.raster, seen.known, *point, hits.walls[i, 2] + poses[k, 2])]
            if line >= 0:
                met.setdefault((line, k), []).append((point, angles[i]))
    for (line, k), own in met.items():
        px, py, lx, ly, _ = seen.lines[line]
        normal = np.array([-ly, lx])
        distances = np.array([normal @ (point - (px, py)) for point, _ in own])
        doubt = 1.0 + (distances.mean() / (CONFIG.robust_width * CONFIG.deviation)) ** 2
        weight = 1.0 / (1.0 + len(own) / CONFIG.enough) / doubt / CONFIG.deviation**2
        for (point, angle), distance in zip(own, distances, strict=True):
            arm = point - poses[k, :2]
            turned = np.array([-arm[1], arm[0]])
            slope = np.zeros(size)
            slope[3 * k : 3 * k + 3] = [*normal, normal @ turned]
            slope[12 + SCALE] = angle * (normal @ turned)
            slope[12 + OFFSET] = normal @ arm / np.hypot(*arm)
            slope[12 + SWEEP] = RATES[k] * angle * (normal @ turned)
            slope[first_line + 2 * line : first_line + 2 * line + 2] = (point - (px, py)) @ [lx, ly], -1.0
            curvature += weight * np.outer(slope, slope)
            gradient += weight * slope * distance
    assert len(met) > 30
    lines, others = curvature[first_line:, first_line:], curvature[:first_line, first_line:]
    return (
        curvature[:first_line, :first_line] - others @ np.linalg.solve(lines, others.T),
        gradient[:first_line] - others @ np.linalg.solve(lines, gradient[first_line:]),
    )


def test_the_equations_are_those_of_all_hits_with_the_lines_eliminated(keyframes, poses, generator):
    gathered_hits, begins = gathered(keyframes, (0, 1, 2, 3), 1000)
    hits = corrected_hits(gathered_hits, begins, np.full(4, 0.004), 0.01)
    at = poses + generator.normal(0.0, 0.005, poses.shape)
    walls = WallLines(hits, 1, at, 0.1, CONFIG)
    laser = laser_equations(hits, gathered_hits[:, 2], RATES, at, walls.seen, walls.system, LIMITS)
    curvature, gradient = plain_equations(hits, gathered_hits[:, 2], at, walls.seen)
    scale = np.abs(curvature).max()
    np.testing.assert_allclose(walls.gradient.ravel(), gradient[:12], atol=1e-6 * scale)
    np.testing.assert_allclose(laser.gradient, gradient[12:], atol=1e-6 * scale)
    np.testing.assert_allclose(laser.own, curvature[12:, 12:], atol=1e-6 * scale)
    np.testing.assert_allclose(laser.across.reshape(12, NUMBERS), curvature[:12, 12:], atol=1e-6 * scale)
