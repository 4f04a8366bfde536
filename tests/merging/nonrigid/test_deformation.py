import math

import numpy as np
import pytest

from merging.nonrigid.deformation import Deformation
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2

MOTION = SE2(3.0, -2.0, 0.7)
MIDDLES = np.array([[4.0, 3.0], [12.0, 3.0], [4.0, 9.0], [12.0, 9.0]])


def bent(turn=0.03, reach_m=4.0):
    """A deformation whose tiles differ from one transform, with rotations of both signs."""
    aside = [SE2(0.2, 0.1, turn), SE2(-0.3, 0.2, -turn), SE2(0.0, -0.3, 0.0), SE2(0.1, 0.0, turn)]
    return Deformation(
        MIDDLES, [MOTION @ SE2(*m, 0.0) @ a @ SE2(*-m, 0.0) for m, a in zip(MIDDLES, aside, strict=True)], reach_m
    )


def test_tiles_of_one_transform_give_a_rigid_deformation():
    deformation = Deformation(MIDDLES, [MOTION] * 4, 4.0)
    points = np.array([[0.0, 0.0], [7.0, 5.0], [30.0, -8.0]])
    np.testing.assert_allclose(deformation.apply(points), MOTION.apply(points), atol=1e-12)
    motion, apart_m, apart_rad = deformation.nearest_rigid()
    assert motion == pytest.approx(MOTION)
    assert (apart_m, apart_rad) == pytest.approx((0.0, 0.0), abs=1e-7)
    assert deformation.motion_at(points[1]) == pytest.approx(MOTION)


def test_the_transform_at_a_tile_is_its_own():
    deformation = bent(reach_m=1.5)
    for middle, motion in zip(deformation.centroids, deformation.motions, strict=True):
        np.testing.assert_allclose(deformation.apply(middle[None])[0], motion.apply(middle), atol=0.01)
        assert deformation.motion_at(middle) == pytest.approx(motion, abs=0.05)


def test_the_deformation_changes_evenly_between_tiles():
    deformation = bent()
    way = np.column_stack((np.linspace(4.0, 12.0, 81), np.full(81, 3.0)))
    steps = np.linalg.norm(np.diff(deformation.apply(way), axis=0), axis=1)
    assert np.abs(steps - 0.1).max() < 0.02


def test_the_nearest_rigid_transform_has_the_rms_residuals_of_the_tiles():
    motion, apart_m, apart_rad = bent().nearest_rigid()
    assert motion == pytest.approx(MOTION, abs=0.25)
    assert 0.05 < apart_m < 0.3
    assert apart_rad == pytest.approx(0.03, abs=0.01)


def test_the_inverse_maps_points_back():
    deformation = bent(reach_m=2.0)
    there = deformation.apply(deformation.centroids)
    np.testing.assert_allclose(deformation.inverse().apply(there), deformation.centroids, atol=0.05)


def test_composed_deformations_are_applied_one_after_the_other():
    first, second = bent(), bent(turn=-0.02, reach_m=5.0)
    onward = Deformation(MOTION.apply(second.centroids), [m @ MOTION.inverse() for m in second.motions], second.reach_m)
    points = np.array([[4.0, 4.0], [8.0, 6.0], [11.0, 8.0]])
    np.testing.assert_allclose(first.then(onward).apply(points), onward.apply(first.apply(points)), atol=0.05)


def test_a_deformation_in_other_frames_maps_the_same_points():
    deformation, target, source = bent(), SE2(7.0, 1.0, 2.0), SE2(-3.0, 5.0, -1.0)
    points = np.array([[4.0, 4.0], [8.0, 6.0], [20.0, 8.0]])
    seen = deformation.in_frames(target, source)
    np.testing.assert_allclose(
        target.apply(seen.apply(source.inverse().apply(points))), deformation.apply(points), atol=1e-9
    )


def test_a_rigid_deformation_leaves_the_map_unchanged(rooms):
    floor = rooms(1)
    same = Deformation(MIDDLES, [MOTION] * 4, 4.0).deformed(floor, MOTION)
    row, col = same.geometry.cell_at(*floor.geometry.centre_of(0, 0))
    np.testing.assert_array_equal(same.masses[row : row + 240, col : col + 320], floor.masses)
    assert same.is_known().sum() == floor.is_known().sum()


@pytest.mark.parametrize("where", [(30, 40), (120, 160), (200, 300)])
def test_the_rigid_transform_of_the_deformed_map_equals_the_deformation(rooms, where):
    floor = rooms(1)
    floor.masses[:] = (0.0, 1.0, 0.0, 0.0)
    row, col = where
    floor.masses[row - 1 : row + 2, col - 1 : col + 2] = (0.0, 0.0, 1.0, 0.0)
    deformation = bent()
    motion = deformation.nearest_rigid()[0]
    straight = deformation.deformed(floor, motion)
    assert straight.fault() is None
    walls = np.nonzero(straight.masses[..., OCCUPIED] > straight.masses[..., FREE])
    there = motion.apply(straight.geometry.centres_of(*walls).mean(axis=0))
    assert math.dist(there, deformation.apply(np.array([floor.geometry.centre_of(row, col)]))[0]) < 0.05


def test_resampling_in_bands_gives_the_same_masses(rooms, monkeypatch):
    floor = rooms(1)
    whole = bent().deformed(floor, MOTION)
    monkeypatch.setattr("merging.nonrigid.deformation._BAND", 24)
    np.testing.assert_array_equal(bent().deformed(floor, MOTION).masses, whole.masses)


def test_a_scale_is_distinguished_from_other_deformations():
    for scale in (0.95, 1.0, 1.05):
        deformation = bent(turn=0.0)
        middle = MIDDLES.mean(axis=0)
        grown = [
            SE2(*(scale - 1.0) * (MOTION.apply(c) - MOTION.apply(middle)), 0.0) @ m
            for c, m in zip(MIDDLES, [MOTION] * 4, strict=True)
        ]
        found, share = Deformation(MIDDLES, grown, 4.0).scale()
        assert found == pytest.approx(scale)
        assert share == pytest.approx(0.0 if scale == 1.0 else 1.0)
        assert deformation.scale()[1] < 0.5
    assert Deformation(MIDDLES[:2], [MOTION, SE2(9.0, 0.0, 0.0) @ MOTION], 4.0).scale() == (1.0, 0.0)
