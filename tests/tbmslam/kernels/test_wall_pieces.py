import math

import numpy as np
import pytest

from tbmslam.kernels.wall_pieces import gather_hits, join_lines, pieces_of, sum_moments
from tbmslam.se2 import SE2


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


def some_hits(generator, count=200, stretches=4):
    """Return hits in the frames of stretches, some without normal, whose they are, and the stretches' poses."""
    angles = generator.uniform(-math.pi, math.pi, count)
    normals = np.column_stack((np.cos(angles), np.sin(angles)))
    normals[generator.random(count) < 0.3] = 0.0
    hits = np.column_stack((generator.uniform(-2.0, 2.0, (count, 2)), normals))
    poses = np.column_stack((generator.uniform(-1.0, 1.0, (stretches, 2)), generator.uniform(-3.0, 3.0, stretches)))
    return hits, np.sort(generator.integers(0, stretches, count)), poses


@pytest.mark.parametrize("every", [1, 7])
def test_hits_are_gathered_as_the_plain_answer_says(scans, every):
    points, normals, offsets = scans
    owners, poses = np.array([0, 0, 1]), np.array([[0.0, 0.0, 0.0], [1.0, -0.5, 0.3], [0.2, 0.0, -2.0]])
    hits, of = gather_hits(points, normals, offsets, owners, poses, every, 0.14, 0.03)
    expected, whose = [], []
    for k in range(3):
        pose, own = SE2(*poses[k]), range(offsets[k], offsets[k + 1])
        for i in own[::every]:
            before, after = (points[min(max(j, own[0]), own[-1])].astype(float) for j in (i - 2, i + 2))
            is_straight = np.hypot(*(after - before)) <= 0.14 and abs(normals[i] @ (points[i] - before)) <= 0.03
            turned = SE2(0.0, 0.0, pose.theta).apply(normals[i].astype(float)) if is_straight else (0.0, 0.0)
            expected.append([*pose.apply(points[i].astype(float)), *turned])
            whose.append(owners[k])
    np.testing.assert_allclose(hits, expected, atol=1e-6)
    np.testing.assert_array_equal(of, whose)
    assert 0.1 < (hits[:, 2:] == 0.0).all(axis=1).mean() < 0.9  # some are near and straight, some are not


def test_the_piece_of_a_hit_is_its_cell_and_where_its_normal_points(generator):
    hits, owners, poses = some_hits(generator)
    pieces, cells = pieces_of(hits, owners, poses, 0.4, 0.1, 8)
    seen = {}
    for hit, owner, piece, cell in zip(hits, owners, pieces, cells, strict=True):
        x, y = SE2(*poses[owner]).apply(hit[:2])
        place = math.floor((x - 0.1) / 0.4), math.floor((y - 0.1) / 0.4)
        assert seen.setdefault(place, cell) == cell  # one number for each cell
        if not hit[2:].any():
            assert piece == -1
            continue
        assert piece // 8 == cell
        away = math.remainder(math.atan2(hit[3], hit[2]) + poses[owner, 2] - piece % 8 * math.pi / 4, 2.0 * math.pi)
        assert abs(away) <= math.pi / 8 + 1e-9
    assert len(set(seen.values())) == len(seen)


def test_moments_are_the_sums_over_the_hits_of_each_stretch_on_each_piece(generator):
    hits, owners, poses = some_hits(generator)
    pieces, _ = pieces_of(hits, owners, poses, 1.0, 0.0, 4)
    order = np.argsort(pieces, kind="stable")
    moments, seers, begins, known = sum_moments(hits, owners, pieces, order[np.searchsorted(pieces[order], 0) :])
    np.testing.assert_array_equal(known, np.unique(pieces[pieces >= 0]))
    for number, piece in enumerate(known):
        own = range(begins[number], begins[number + 1])
        assert list(seers[own]) == sorted(set(owners[pieces == piece]))
        for o in own:
            x, y = hits[(pieces == piece) & (owners == seers[o]), :2].T
            sums = [len(x), x.sum(), y.sum(), (x * x).sum(), (x * y).sum(), (y * y).sum()]
            np.testing.assert_allclose(moments[o], sums, atol=1e-12)
    assert begins[-1] == len(moments) == len(seers)


def test_no_hits_make_no_pieces():
    none = np.zeros(0, dtype=np.int64)
    pieces, cells = pieces_of(np.zeros((0, 4)), none, np.zeros((1, 3)), 0.5, 0.0, 8)
    moments, seers, begins, known = sum_moments(np.zeros((0, 4)), none, pieces, none)
    assert [len(one) for one in (pieces, cells, moments, seers, begins, known)] == [0, 0, 0, 0, 1, 0]


@pytest.mark.parametrize(
    ("hit", "piece"),
    [
        ((0.1, 0.02), 3),  # on the wall
        ((0.1, 0.2), -1),  # too far behind it
        ((0.29, 0.02), -1),  # past what is known of it
        ((0.02, -0.02), -1),  # where a jamb may be meant as well
    ],
)
def test_a_hit_without_normal_joins_the_only_line_it_can_lie_on(hit, piece):
    # A wall above the robot that faces down (sector 3 of 4), and a jamb at its left end that faces right (sector 0).
    known = np.array([0, 3])
    lines = np.array([[0.0, -0.05, 0.0, 1.0, 0.05], [0.13, 0.0, 1.0, 0.0, 0.13]])
    hits, poses = np.array([[hit[0] - 1.0, hit[1] + 3.0, 0.0, 0.0]]), np.array([[1.0, -3.0, 0.0]])
    none = np.zeros(1, dtype=np.int64)
    assert join_lines(hits, none, poses, none - 1, none, known, lines, 4, 0.06)[0] == piece


def test_a_hit_joins_no_line_that_faces_away_from_who_saw_it():
    known, lines = np.array([3]), np.array([[0.0, 0.0, 1.0, 0.0, 0.2]])  # faces down
    none = np.zeros(1, dtype=np.int64)
    for side, expected in ((-1.0, 3), (1.0, -1)):
        hits, poses = np.array([[0.0, -2.0 * side, 0.0, 0.0]]), np.array([[0.0, 2.0 * side, 0.0]])
        assert join_lines(hits, none, poses, none - 1, none, known, lines, 4, 0.06)[0] == expected


def test_a_hit_whose_piece_is_known_keeps_it(generator):
    hits, owners, poses = some_hits(generator, 20)
    pieces = np.arange(20)
    found = join_lines(hits, owners, poses, pieces, pieces, pieces, np.zeros((20, 5)), 8, 0.1)
    np.testing.assert_array_equal(found, pieces)
