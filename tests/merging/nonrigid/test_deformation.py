import math

import numpy as np
import pytest

from merging.config import MergeConfig
from merging.config.registration import StructureConfig
from merging.fusion import warp
from merging.nonrigid import deformation
from merging.nonrigid.deformation import DeformableMap, Deformation, deformed_by, fit_tiles, tiles_of
from merging.verification import examine
from merging.walls import WallMap
from tbmslam.belief.grid import TbmGrid
from tbmslam.belief.masses import FREE, OCCUPIED, UNKNOWN
from tbmslam.belief.tiled_masses import SIDE
from tbmslam.geometry.se2 import SE2
from tests.merging.bent_floor import bent_maps

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
    motion = deformation.nearest_rigid()
    apart_m, apart_rad = deformation.residuals(motion)
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


def test_the_transform_of_the_overlap_fits_the_common_cells_best(rooms):
    """Three of four tiles lie in one half of the map, and the other half counts as much."""
    source = WallMap.from_grid(rooms(1), CONFIG.structure)  # 16 x 12 m
    centroids = np.array([[2.0, 3.0], [2.0, 9.0], [6.0, 6.0], [14.0, 6.0]])
    deformation = Deformation(centroids, [MOTION, MOTION, MOTION, MOTION @ SE2(0.3, -0.2, 0.04)], 3.0)
    target = WallMap.from_grid(warp(rooms(1), MOTION, rooms(1).geometry), CONFIG.structure)
    found, of_tiles = deformation.nearest_in_overlap(target, source), deformation.nearest_rigid()
    points = source.geometry.centres_of(*np.nonzero(source.known))
    moved = deformation.apply(points)
    rows, cols, inside = target.geometry.cells_at(moved)
    common = inside & target.known[rows, cols]

    def misfit(motion):
        return ((motion.apply(points[common]) - moved[common]) ** 2).sum()

    assert misfit(found) < 0.97 * misfit(of_tiles)
    for step in (SE2(0.01, 0.0, 0.0), SE2(0.0, 0.01, 0.0), SE2(0.0, 0.0, 0.003)):
        assert misfit(found) < min(misfit(found @ step), misfit(found @ step.inverse()))
    nowhere = WallMap.from_grid(warp(rooms(1), SE2(90.0, 0.0, 0.0), rooms(1).geometry), CONFIG.structure)
    assert deformation.nearest_in_overlap(nowhere, source) == of_tiles


def test_the_nearest_rigid_transform_has_the_rms_residuals_of_the_tiles():
    motion = bent().nearest_rigid()
    apart_m, apart_rad = bent().residuals(motion)
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
    motion = deformation.nearest_rigid()
    straight = deformation.deformed(floor, motion)
    assert straight.fault() is None
    walls = np.nonzero(straight.masses[..., OCCUPIED] > straight.masses[..., FREE])
    there = motion.apply(straight.geometry.centres_of(*walls).mean(axis=0))
    assert math.dist(there, deformation.apply(np.array([floor.geometry.centre_of(row, col)]))[0]) < 0.05


def test_resampling_in_bands_gives_the_same_masses(rooms, monkeypatch):
    floor = rooms(1)
    whole = bent().deformed(floor, MOTION)
    monkeypatch.setattr("merging.nonrigid.deformation._BAND", SIDE)
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
    assert Deformation(MIDDLES, grown, 4.0).scale_error() == pytest.approx(1.05)
    stretched = [SE2(*(0.05, 0.01) * (MOTION.apply(c) - MOTION.apply(middle)), 0.0) @ MOTION for c in MIDDLES]
    assert 0.5 < Deformation(MIDDLES, stretched, 4.0).scale()[1] < 0.8
    assert Deformation(MIDDLES, stretched, 4.0).scale_error() is None
    assert Deformation(MIDDLES[:2], [MOTION, SE2(9.0, 0.0, 0.0) @ MOTION], 4.0).scale() == (1.0, 0.0)


CONFIG = MergeConfig.model_validate({"nonrigid": {"side_m": 8.0}})


def agreement(target, grid, motion):
    structure = WallMap.from_grid(grid, CONFIG.structure)
    return examine(target, structure, motion, CONFIG.verification).agreement


def deform(target, source, start, config):
    fit = fit_tiles(target, source, start, config)
    return deformed_by(fit.deformation, fit.deformation.nearest_in_overlap(target, source.structure), source)


def test_an_equal_map_is_not_deformed(rooms):
    floor = rooms(1)
    found = deform(
        WallMap.from_grid(floor, CONFIG.structure), DeformableMap.of(floor, CONFIG), SE2(0.2, -0.1, 0.02), CONFIG
    )
    assert found.motion == pytest.approx(SE2.identity(), abs=1e-3)
    assert (found.residual_m, found.residual_rad) == pytest.approx((0.0, 0.0), abs=2e-3)
    np.testing.assert_array_equal(found.grid.is_known().sum(), floor.is_known().sum())


def test_a_distorted_map_fits_better_after_deformation():
    target, source, true = bent_maps("store")
    fixed = WallMap.from_grid(target.grid, CONFIG.structure)
    found = deform(fixed, DeformableMap.of(source.grid, MergeConfig()), true, MergeConfig())
    assert agreement(fixed, found.grid, found.motion) > agreement(fixed, source.grid, found.motion) + 0.2
    middle = np.array([np.mean(source.grid.geometry.bounds()[i::2]) for i in range(2)])
    assert math.dist(found.motion.apply(middle), true.apply(middle)) < 0.5
    assert 0.1 < found.residual_m < 1.0


@pytest.mark.parametrize("elsewhere", [SE2(100.0, 0.0, 0.0), SE2(9.0, 4.0, 1.0)])
def test_no_map_is_deformed_at_a_pose_where_few_tiles_fit(rooms, elsewhere):
    floor = rooms(1)
    fixed, moving = WallMap.from_grid(floor, CONFIG.structure), DeformableMap.of(floor, CONFIG)
    assert fit_tiles(fixed, moving, elsewhere, CONFIG) is None


def test_small_tiles_fit_where_large_ones_overlap_too_little(monkeypatch):
    target, source, true = bent_maps("store")
    fixed, moving = WallMap.from_grid(target.grid, CONFIG.structure), DeformableMap.of(source.grid, MergeConfig())
    large, small = moving.rounds[:2]
    register = deformation._registered_tiles
    monkeypatch.setattr(
        deformation,
        "_registered_tiles",
        lambda target, tiles, *given: None if tiles is large else register(target, tiles, *given),
    )
    found = fit_tiles(fixed, moving, true, MergeConfig())
    assert len(found.deformation.motions) > 0.5 * len(small)


def test_small_tiles_that_do_not_fit_are_not_tried_again(monkeypatch):
    target, source, true = bent_maps("store")
    fixed, moving = WallMap.from_grid(target.grid, CONFIG.structure), DeformableMap.of(source.grid, MergeConfig())
    large, small = moving.rounds[:2]
    tried, register = [], deformation._registered_tiles

    def registered(target, tiles, *given):
        tried.append(tiles)
        return register(target, tiles, *given) if tiles is large else None

    monkeypatch.setattr(deformation, "_registered_tiles", registered)
    assert fit_tiles(fixed, moving, true, MergeConfig()) is None
    assert [tiles is small for tiles in tried] == [False, True]


def test_a_map_of_one_large_tile_starts_with_small_tiles(rooms):
    large, small = (
        DeformableMap.of(rooms(1), MergeConfig.model_validate({"nonrigid": {"side_m": side}})) for side in (8.0, 20.0)
    )
    assert [len(tiles) for tiles in large.rounds] == [4, 12, 12]
    assert [len(tiles) for tiles in small.rounds] == [4, 4]


def test_two_large_tiles_are_registered_before_small_ones(rooms):
    floor = rooms(1)
    floor.masses[160:] = (0.0, 0.0, 0.0, 1.0)  # 16 x 8 m are left
    first, *others = DeformableMap.of(floor, CONFIG).rounds
    assert len(first) == 2
    assert len(others) == 2
    assert all(len(tiles) > 2 for tiles in others)


def cut(floor, side_m, most=100):
    return tiles_of(WallMap.from_grid(floor, StructureConfig()), side_m, most)


def test_tiles_have_one_size_and_the_cells_of_the_map(rooms):
    floor = rooms(1)  # 16 x 12 m
    tiles = cut(floor, 4.0)
    assert {tile.geometry[3:] for tile in tiles} == {(80, 80)}
    assert len(tiles) == 12
    free = floor.masses[..., FREE] > floor.masses[..., OCCUPIED]
    for tile in tiles:
        row, col = floor.geometry.cell_at(*tile.geometry.centre_of(0, 0))
        np.testing.assert_array_equal(tile.free, free[row : row + 80, col : col + 80])


def test_no_side_is_longer_than_requested(rooms):
    assert {tile.geometry[3:] for tile in cut(rooms(1), 7.0)} <= {(120, 107), (120, 106)}


def test_unknown_margins_are_cropped_first(rooms):
    floor = rooms(1)
    masses = np.zeros((400, 700, 4), dtype=np.float32)
    masses[..., UNKNOWN] = 1.0
    masses[100:340, 200:520] = floor.masses
    tiles = cut(TbmGrid(floor.geometry._replace(rows=400, cols=700), masses), 20.0)
    assert [tile.geometry[1:] for tile in tiles] == [pytest.approx((10.0, 5.0, 240, 320))]


def test_large_maps_have_larger_tiles(rooms):
    assert 4 <= len(cut(rooms(1), 2.0, most=6)) <= 6


def test_tiles_with_little_wall_are_left_out(rooms):
    floor = rooms(1)
    floor.masses[:, :160] = (0.0, 1.0, 0.0, 0.0)
    floor.masses[50:90, 40] = (0.0, 0.0, 1.0, 0.0)  # two metres of wall
    assert {tile.geometry.origin_x for tile in cut(floor, 8.0)} == {8.0}


def test_the_centroid_is_of_the_walls(rooms):
    floor = rooms(1)
    floor.masses[:] = (0.0, 1.0, 0.0, 0.0)
    floor.masses[40:80, 60] = (0.0, 0.0, 1.0, 0.0)
    np.testing.assert_allclose(WallMap.from_grid(floor, StructureConfig()).centroid, (3.025, 3.0))
