import math

import numpy as np
import pytest

from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.adjustment.wall_pieces import (
    Pieces,
    Raster,
    StretchHits,
    _is_on,
    gather_hits,
    join_walls,
    lines_by_cell,
    see_walls,
    sort_sightings,
)

RASTER = Raster(0.4, 0.1, 8)


@pytest.fixture
def scans(generator):
    """Hits of three scans on the walls of a room, their normals and where each scan begins."""
    angles = np.linspace(-math.pi, math.pi, 400, endpoint=False)
    reach = 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    points = np.column_stack((reach * np.cos(angles), reach * np.sin(angles)))
    normals = -np.where(
        (np.abs(np.cos(angles)) > np.abs(np.sin(angles)))[:, None],
        np.column_stack((np.sign(np.cos(angles)), 0 * angles)),
        np.column_stack((0 * angles, np.sign(np.sin(angles)))),
    )
    all_points = np.vstack([points + generator.normal(0.0, 0.02, points.shape) for _ in range(3)])
    offsets = np.arange(4) * len(points)
    return all_points.astype(np.float32), np.vstack([normals] * 3).astype(np.float32), offsets


@pytest.fixture
def hits(generator):
    """Hits of four stretches, the third of which saw nothing, in many cells."""
    walls = np.column_stack((generator.uniform(-9.0, 9.0, (5000, 2)), generator.uniform(-math.pi, math.pi, 5000)))
    loose = generator.uniform(-9.0, 9.0, (2000, 2))
    counts = np.array([0, 1500, 3100, 3100, 5000])
    return StretchHits(walls.astype(np.float32), counts, loose.astype(np.float32), counts * 2 // 5)


@pytest.fixture
def poses(generator):
    return np.column_stack((generator.uniform(-1.0, 1.0, (4, 2)), generator.uniform(-3.0, 3.0, 4)))


@pytest.mark.parametrize("every", [1, 7])
def test_hits_are_gathered_as_the_plain_answer_says(scans, every):
    points, normals, offsets = scans
    places = np.array([[0.0, 0.0, 0.0], [1.0, -0.5, 0.3], [0.2, 0.0, -2.0]])
    hits, sines = gather_hits(points, normals, offsets, places, every, (2.6, 0.14, 0.03))
    walls, loose, wall_begins, loose_begins = [], [], [0], [0]
    for k in range(3):
        pose, own = SE2(*places[k]), range(offsets[k], offsets[k + 1])
        for i in own[::every]:
            before, after = (points[min(max(j, own[0]), own[-1])].astype(float) for j in (i - 2, i + 2))
            is_straight = np.hypot(*(after - before)) <= 0.14 and abs(normals[i] @ (points[i] - before)) <= 0.03
            if np.hypot(*points[i]) > 2.6:
                continue
            there, turned = (
                pose.apply(points[i].astype(float)),
                SE2(0.0, 0.0, pose.theta).apply(normals[i].astype(float)),
            )
            if is_straight:
                walls.append([*there, *turned])
            else:
                loose.append(there)
        wall_begins.append(len(walls))
        loose_begins.append(len(loose))
    np.testing.assert_allclose(np.column_stack((hits.walls, sines)), walls, atol=1e-6)
    np.testing.assert_allclose(hits.loose, loose, atol=1e-6)
    np.testing.assert_array_equal(hits.wall_begins, wall_begins)
    np.testing.assert_array_equal(hits.loose_begins, loose_begins)
    assert min(len(walls), len(loose)) > 0.1 * (len(walls) + len(loose))


def plain_pieces(hits, every, poses):
    """Return places along the map's axes from the stretch, by cell and direction, and by stretch."""
    pieces = {}
    for k, pose in enumerate(poses):
        turn = SE2(0.0, 0.0, pose[2])
        for x, y, facing in hits.walls[hits.wall_begins[k] : hits.wall_begins[k + 1] : every].astype(float):
            way = turn.apply(np.array([x, y]))
            cell = tuple(np.floor((pose[:2] + way - RASTER.shift) / RASTER.cell).astype(int).tolist())
            sector = round((facing + pose[2]) / (2.0 * math.pi) * RASTER.sectors) % RASTER.sectors
            pieces.setdefault((*cell, sector), {}).setdefault(k, []).append(way)
    return pieces


def moments_of(ways):
    x, y = np.array(ways).T
    return [len(x), x.sum(), y.sum(), (x * x).sum(), (x * y).sum(), (y * y).sum()]


@pytest.mark.parametrize("every", [1, 3])
def test_sightings_are_the_sums_over_what_a_stretch_hit_in_a_cell_in_a_direction(hits, poses, every):
    seen, known = see_walls(hits, every, poses, RASTER)
    expected = plain_pieces(hits, every, poses)
    assert len(expected) == seen.pieces_met == len(np.unique(known.numbers[known.numbers >= 0]))
    assert np.all(np.diff(seen.observers[: seen.size]) >= 0)
    # Pieces are numbered as they are met.
    first = {piece: number for number, piece in enumerate(expected)}
    found = {(first[piece], k): moments_of(ways) for piece, own in expected.items() for k, ways in own.items()}
    assert len(found) == seen.size
    for o in range(seen.size):
        moments, observer, piece = seen.moments[o], seen.observers[o], seen.pieces[o]
        np.testing.assert_allclose(moments, found[int(piece), int(observer)], rtol=1e-9, atol=1e-9)


def test_sightings_are_sorted_by_piece(hits, poses):
    seen, _ = see_walls(hits, 1, poses, RASTER)
    numbers, pieces = np.arange(seen.pieces_met) // 2, seen.pieces[: seen.size]
    numbers[::6] = -1
    moments, observers, begins = sort_sightings(seen, numbers, int(numbers.max()) + 1)
    for number in range(0, len(begins) - 1, 50):
        own = np.flatnonzero(numbers[pieces] == number)
        some = slice(begins[number], begins[number + 1])
        np.testing.assert_array_equal(moments[some], seen.moments[own])
        np.testing.assert_array_equal(observers[some], seen.observers[own])
    assert begins[-1] == len(moments) == np.count_nonzero(numbers[pieces] >= 0)


def test_no_hits_make_no_pieces():
    none = StretchHits(np.zeros((0, 3), np.float32), np.zeros(2, int), np.zeros((0, 2), np.float32), np.zeros(2, int))
    seen, known = see_walls(none, 1, np.zeros((1, 3)), RASTER)
    assert (seen.size, seen.pieces_met) == (0, 0)
    assert join_walls(none, 1, np.zeros((1, 3)), RASTER, seen, known, np.zeros((0, 5)), 0.1).size == 0
    assert [len(one) for one in sort_sightings(seen, np.zeros(0, int), 0)] == [0, 0, 1]


def joined(hit, pose, walls, lines):
    """Return the pieces that a hit at a place of the map joins, as seen from a pose; walls are x, y, facing."""
    before = np.array([[0.0, 0.0, 0.0]])
    way = SE2(*pose).inverse().apply(np.array(hit))
    hits = StretchHits(
        np.array(walls, dtype=np.float32), np.array([0, len(walls), len(walls)]), way[None].astype(np.float32),
        np.array([0, 0, 1]),
    )  # fmt: skip
    poses, raster = np.vstack((before, pose)), Raster(0.5, 0.0, 4)
    seen, known = see_walls(hits, 1, poses, raster)
    after = join_walls(hits, 1, poses, raster, seen, known, np.array(lines, dtype=float), 0.06)
    assert seen.pieces[: seen.size].tolist() == list(range(len(walls)))
    assert np.all(after.observers[seen.size : after.size] == 1)
    return after.pieces[seen.size : after.size].tolist()


@pytest.mark.parametrize(
    ("hit", "pieces"),
    [
        ((0.1, 0.02), [0]),  # on the wall
        ((0.1, 0.2), []),  # too far behind it
        ((0.29, 0.02), []),  # past what is known of it
        ((0.02, 0.03), []),  # where a jamb may be meant as well
        ((0.7, 0.02), []),  # in a cell without walls
    ],
)
def test_a_hit_without_normal_joins_the_only_line_it_can_lie_on(hit, pieces):
    # A wall above the robot that faces down, and a jamb at its left end that faces right.
    walls = [(0.1, 0.01, -math.pi / 2), (0.01, 0.01, 0.0)]
    lines = [[0.13, 0.0, 1.0, 0.0, 0.13], [0.0, 0.02, 0.0, 1.0, 0.05]]
    assert joined(hit, (1.0, -3.0, 0.4), walls, lines) == pieces
    alone = [lines[0], [0.0] * 5]  # the jamb is no line
    assert joined((0.02, 0.03), (1.0, -3.0, 0.4), walls, alone) == [0]


@pytest.mark.parametrize(("side", "pieces"), [(-1.0, [0]), (1.0, [])])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_hit_joins_no_line_that_faces_away_from_who_saw_it(side, pieces, direction):
    walls, lines = [(0.1, 0.01, -math.pi / 2)], [[0.1, 0.0, direction, 0.0, 0.2]]  # faces down
    assert joined((0.1, 0.01), (0.2, 2.0 * side, 2.0), walls, lines) == pieces


def test_hits_that_join_a_piece_their_stretch_saw_are_added_to_what_it_saw():
    hits = StretchHits(
        np.array([[0.1, 0.01, -1.6], [0.1, 0.01, -1.6]], dtype=np.float32), np.array([0, 1, 2]),
        np.array([[0.2, 0.02], [0.3, 0.02]], dtype=np.float32), np.array([0, 0, 2]),
    )  # fmt: skip
    poses, raster = np.array([[0.0, -1e-3, 0.0], [0.0, -1e-3, 0.0]]), Raster(0.5, -0.1, 4)
    seen, known = see_walls(hits, 1, poses, raster)
    after = join_walls(hits, 1, poses, raster, seen, known, np.array([[0.2, 0.01, 1.0, 0.0, 0.2]]), 0.06)
    assert after.observers[: after.size].tolist() == [0, 1]
    assert after.moments[: after.size, 0].tolist() == [1.0, 3.0]
    assert after.moments[1, 1] == pytest.approx(0.6, abs=1e-6)


def test_lines_are_listed_by_cell():
    known = Pieces(np.zeros((4, 2), dtype=np.int64), np.array([0, -1, 1, -1, 2, -1, -1, -1, -1, 3, -1, -1]))
    lines = np.array([[0, 0, 1, 0, 0.1], [0, 0, 1, 0, 0.1], [0, 0, 0, 1, 0.1], [0, 0, 0, 0, 0]], dtype=float)
    begins, members = lines_by_cell(known, lines, 4)
    assert begins.tolist() == [0, 2, 3, 3]
    assert members.tolist() == [0, 1, 2]
    # The pieces face right, left and right: what they face is on the left of their lines, or square to them.
    np.testing.assert_array_equal(lines[:, 2:4], [[1, 0], [1, 0], [0, -1], [0, 0]])


def test_a_hit_is_on_a_line_that_is_there_and_faces_the_laser(generator):
    """The way to the hit must come from the line's front, and not along it."""
    told = []
    for _ in range(400):
        x, y, heading, half = *generator.uniform(-2.0, 2.0, 2), generator.uniform(-3.0, 3.0), 0.6
        line = np.array([[x, y, math.cos(heading), math.sin(heading), half]])
        along, aside, bearing, length = generator.uniform((-0.9, -0.15, -3.2, 1.0), (0.9, 0.15, 3.2, 8.0))
        end = SE2(x, y, heading).apply(np.array([along, aside]))
        told.append(_is_on(line, 0, *end, length * math.cos(bearing), length * math.sin(bearing), 0.1))
        # The line's front is where a beam goes against its normal, which is on the left of the line.
        grazing = math.sin(heading - bearing)
        assert told[-1] == (abs(along) <= half and abs(aside) <= 0.1 and grazing > 0.02)
    assert 40 < sum(told) < 360
