import math

import numpy as np
import pytest

from merging.nonrigid.deformation import Deformation
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2

MOTION = SE2(3.0, -2.0, 0.7)
MIDDLES = np.array([[4.0, 3.0], [12.0, 3.0], [4.0, 9.0], [12.0, 9.0]])


def bent(turn=0.03, reach_m=4.0):
    """A motion, and tiles that lie beside it, some turned one way and some the other."""
    aside = [SE2(0.2, 0.1, turn), SE2(-0.3, 0.2, -turn), SE2(0.0, -0.3, 0.0), SE2(0.1, 0.0, turn)]
    return Deformation(
        MIDDLES, [MOTION @ SE2(*m, 0.0) @ a @ SE2(*-m, 0.0) for m, a in zip(MIDDLES, aside, strict=True)], reach_m
    )


def test_tiles_that_all_say_one_thing_are_not_bent():
    bend = Deformation(MIDDLES, [MOTION] * 4, 4.0)
    points = np.array([[0.0, 0.0], [7.0, 5.0], [30.0, -8.0]])
    np.testing.assert_allclose(bend.apply(points), MOTION.apply(points), atol=1e-12)
    motion, apart_m, apart_rad = bend.rigid()
    assert motion == pytest.approx(MOTION)
    assert (apart_m, apart_rad) == pytest.approx((0.0, 0.0), abs=1e-7)
    assert bend.motion_at(points[1]) == pytest.approx(MOTION)


def test_near_a_tile_its_own_word_counts():
    bend = bent(reach_m=1.5)
    for middle, motion in zip(bend.centroids, bend.motions, strict=True):
        np.testing.assert_allclose(bend.apply(middle[None])[0], motion.apply(middle), atol=0.01)
        assert bend.motion_at(middle) == pytest.approx(motion, abs=0.05)


def test_between_tiles_it_changes_evenly():
    bend = bent()
    way = np.column_stack((np.linspace(4.0, 12.0, 81), np.full(81, 3.0)))
    steps = np.linalg.norm(np.diff(bend.apply(way), axis=0), axis=1)
    assert np.abs(steps - 0.1).max() < 0.02


def test_what_a_rigid_motion_leaves_is_told():
    motion, apart_m, apart_rad = bent().rigid()
    assert motion == pytest.approx(MOTION, abs=0.25)
    assert 0.05 < apart_m < 0.3
    assert apart_rad == pytest.approx(0.03, abs=0.01)


def test_the_inverse_leads_back():
    bend = bent(reach_m=2.0)
    there = bend.apply(bend.centroids)
    np.testing.assert_allclose(bend.inverse().apply(there), bend.centroids, atol=0.05)


def test_one_bend_after_another():
    first, second = bent(), bent(turn=-0.02, reach_m=5.0)
    onward = Deformation(MOTION.apply(second.centroids), [m @ MOTION.inverse() for m in second.motions], second.reach_m)
    points = np.array([[4.0, 4.0], [8.0, 6.0], [11.0, 8.0]])
    np.testing.assert_allclose(first.then(onward).apply(points), onward.apply(first.apply(points)), atol=0.05)


def test_a_bend_is_the_same_seen_from_other_frames():
    bend, target, source = bent(), SE2(7.0, 1.0, 2.0), SE2(-3.0, 5.0, -1.0)
    points = np.array([[4.0, 4.0], [8.0, 6.0], [20.0, 8.0]])
    seen = bend.seen_from(target, source)
    np.testing.assert_allclose(target.apply(seen.apply(source.inverse().apply(points))), bend.apply(points), atol=1e-9)


def test_a_map_that_is_not_bent_stays_as_it_is(rooms):
    floor = rooms(1)
    same = Deformation(MIDDLES, [MOTION] * 4, 4.0).straightened(floor, MOTION)
    row, col = same.geometry.cell_at(*floor.geometry.centre_of(0, 0))
    np.testing.assert_array_equal(same.masses[row : row + 240, col : col + 320], floor.masses)
    assert same.is_known().sum() == floor.is_known().sum()


@pytest.mark.parametrize("where", [(30, 40), (120, 160), (200, 300)])
def test_a_rigid_motion_lays_the_straightened_map_where_the_bent_one_belongs(rooms, where):
    floor = rooms(1)
    floor.masses[:] = (0.0, 1.0, 0.0, 0.0)
    row, col = where
    floor.masses[row - 1 : row + 2, col - 1 : col + 2] = (0.0, 0.0, 1.0, 0.0)
    bend = bent()
    motion = bend.rigid()[0]
    straight = bend.straightened(floor, motion)
    assert straight.fault() is None
    walls = np.nonzero(straight.masses[..., OCCUPIED] > straight.masses[..., FREE])
    there = motion.apply(straight.geometry.centres_of(*walls).mean(axis=0))
    assert math.dist(there, bend.apply(np.array([floor.geometry.centre_of(row, col)]))[0]) < 0.05


def test_large_maps_are_drawn_some_rows_at_a_time(rooms, monkeypatch):
    floor = rooms(1)
    whole = bent().straightened(floor, MOTION)
    monkeypatch.setattr("merging.nonrigid.deformation._BAND", 24)
    np.testing.assert_array_equal(bent().straightened(floor, MOTION).masses, whole.masses)


def test_a_scale_is_told_beside_what_else_bends_a_map():
    for scale in (0.95, 1.0, 1.05):
        bend = bent(turn=0.0)
        middle = MIDDLES.mean(axis=0)
        grown = [
            SE2(*(scale - 1.0) * (MOTION.apply(c) - MOTION.apply(middle)), 0.0) @ m
            for c, m in zip(MIDDLES, [MOTION] * 4, strict=True)
        ]
        found, share = Deformation(MIDDLES, grown, 4.0).scale()
        assert found == pytest.approx(scale)
        assert share == pytest.approx(0.0 if scale == 1.0 else 1.0)
        assert bend.scale()[1] < 0.5
    assert Deformation(MIDDLES[:2], [MOTION, SE2(9.0, 0.0, 0.0) @ MOTION], 4.0).scale() == (1.0, 0.0)
