import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merging.fusion import (
    RULES,
    Fusion,
    at_resolution,
    canvas_over,
    conflict_places,
    fuse,
    offset_in,
    place,
    warp,
    window_over,
)
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.masses import CONFLICT, FREE, OCCUPIED, UNKNOWN, VACUOUS
from tbmslam.geometry.se2 import SE2
from tbmslam.kernels.grids.fusion import add_layer
from tests.reference import is_inside

LATTICE = GridGeometry(0.1, -0.35, 0.2, 5, 5)


def block(rows, cols, resolution=0.1, origin=(0.0, 0.0), margin=0, belief=(0.0, 0.25, 0.5, 0.25)):
    grid = TbmGrid.unknown(GridGeometry(resolution, *origin, rows + 2 * margin, cols + 2 * margin))
    grid.masses[margin : margin + rows, margin : margin + cols] = belief
    return grid


def test_the_same_frame_and_lattice_change_nothing():
    grid = block(6, 9, margin=3)
    warped = warp(grid, SE2.identity(), grid.geometry)
    assert warped.geometry == grid.cropped_to_known().geometry
    assert warped.masses.tobytes() == grid.cropped_to_known().masses.tobytes()


@pytest.mark.parametrize("theta", [0.3, 1.2, math.pi / 2, -2.5])
@pytest.mark.parametrize("resolution", [0.02, 0.05, 0.1])
def test_no_evidence_is_cut_off(theta, resolution):
    def evidence_of(belief):
        grid = block(20, 30, resolution, origin=(-5.0, 2.0), margin=4, belief=belief)
        warped = warp(grid, SE2(-3.3, 8.8, theta), LATTICE)
        assert offset_in(LATTICE, warped.geometry)  # on the lattice, wherever it lies
        return np.sum(1.0 - warped.masses[..., UNKNOWN]) * 0.1**2

    area = 600 * resolution**2
    assert evidence_of((0.0, 0.5, 0.25, 0.25)) == pytest.approx(0.75 * area, rel=0.15)
    # A wall fills the coarser cells at its outline, up to half a cell farther than it reaches.
    outline = 0.05 * 100 * resolution if resolution < 0.1 else 0.0
    occupied = evidence_of((0.0, 0.25, 0.5, 0.25))
    assert 0.75 * 0.85 * area <= occupied <= 0.75 * 1.15 * (area + outline)


def test_a_window_over_whole_cells_has_no_extra_rows():
    geometry = GridGeometry(0.1, 0.3, 0.3, 4, 6)
    lattice = GridGeometry(0.1, -7.7, 12.1, 3, 3)
    window = window_over(geometry, SE2(0.4, -0.2, math.pi / 2), lattice)
    assert (window.rows, window.cols) == (6, 4)


def test_another_resolution_keeps_the_place():
    grid = block(20, 30, 0.05, origin=(1.0, -2.0), margin=2)
    coarse = at_resolution(grid, 0.1)
    assert coarse.geometry.resolution == 0.1
    assert coarse.is_known().sum() == 150
    assert coarse.geometry.bounds() == pytest.approx(grid.cropped_to_known().geometry.bounds())
    assert at_resolution(grid, 0.05).masses.shape == (20, 30, 4)


def test_a_canvas_covers_all_windows():
    windows = [GridGeometry(0.1, 0.0, 0.0, 4, 5), GridGeometry(0.1, -0.3, 0.2, 6, 2)]
    canvas = canvas_over(windows)
    assert canvas == pytest.approx(GridGeometry(0.1, -0.3, 0.0, 8, 8))
    assert [offset_in(canvas, window) for window in windows] == [(0, 3), (2, 0)]


def test_windows_off_the_lattice_are_refused():
    with pytest.raises(ValueError, match="cut from one lattice of cells"):
        canvas_over([GridGeometry(0.1, 0.0, 0.0, 4, 5), GridGeometry(0.1, 0.05, 0.0, 4, 5)])
    with pytest.raises(ValueError, match="cut from one lattice of cells"):
        offset_in(GridGeometry(0.1, 0.0, 0.0, 4, 5), GridGeometry(0.2, 0.0, 0.0, 4, 5))
    with pytest.raises(ValueError, match="windows must not be empty"):
        canvas_over([])


def test_unseen_cells_stay_unknown():
    warped = warp(block(10, 10), SE2(0.0, 0.0, 0.5), LATTICE)
    assert np.all(warped.masses[0, 0] == (0.0, 0.0, 0.0, 1.0))
    assert np.all(warped.masses[..., UNKNOWN][~warped.is_known()] == 1.0)


@pytest.mark.parametrize("stretch", [0.0, 5e-7, 1.5e-6, 5e-6, 1e-4])
def test_a_resampled_grid_can_be_placed_on_a_lattice_of_its_resolution(stretch):
    grid = block(20, 30, 0.05, origin=(1.0, -2.0), margin=2)
    lattice = grid.cropped_to_known().geometry._replace(resolution=0.05 * (1.0 + stretch))
    assert offset_in(lattice, at_resolution(grid, lattice.resolution).geometry) == (0, 0)


CERTAIN = {"free": (0, 1, 0, 0), "occupied": (0, 0, 1, 0), "unknown": (0, 0, 0, 1)}


def grid(*cells, col=0):
    masses = np.array([[CERTAIN.get(cell, cell) for cell in cells]], dtype=np.float32)
    return TbmGrid(GridGeometry(0.1, 0.1 * col, 0.0, *masses.shape[:2]), masses)


def random_layer(rng):
    rows, cols = rng.integers(2, 7, size=2)
    masses = rng.dirichlet(np.ones(4), size=(rows, cols))
    masses[rng.random((rows, cols)) < 0.3] = VACUOUS
    row, col = rng.integers(-3, 4, size=2)
    return TbmGrid(GridGeometry(0.1, 0.1 * col, 0.1 * row, rows, cols), masses.astype(np.float32))


def combine_by_definition(rule, beliefs):
    """Equations 5 and 6 as sums over subsets, a pair at a time."""
    combined = beliefs[0]
    for belief in beliefs[1:]:
        total = np.zeros(4)
        for b, c in itertools.product(range(4), range(4)):
            total[b & c if rule == "conjunctive" else b | c] += combined[b] * belief[c]
        combined = total
    return combined


def belief_at(layer, x, y):
    row, col = layer.geometry.cell_at(x, y)
    return layer.masses[row, col].astype(np.float64) if is_inside(layer.geometry, row, col) else VACUOUS


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    count=st.integers(2, 4),
    rule=st.sampled_from(["disjunctive", "conjunctive"]),
    coverage=st.sampled_from(["union", "overlap"]),
)
def test_every_cell_is_what_the_equations_say(seed, count, rule, coverage):
    rng = np.random.default_rng(seed)
    layers = [random_layer(rng) for _ in range(count)]
    fusion = fuse(layers, rule, coverage)
    geometry = fusion.grid.geometry
    for row, col in itertools.product(range(geometry.rows), range(geometry.cols)):
        beliefs = [belief_at(layer, *geometry.centre_of(row, col)) for layer in layers]
        seen = [belief for belief in beliefs if belief[UNKNOWN] < 1.0]
        lost = not seen or (coverage == "overlap" and len(seen) < count)
        expected = VACUOUS if lost else combine_by_definition(rule, seen)
        np.testing.assert_allclose(fusion.grid.masses[row, col], expected, atol=1e-5)
        assert fusion.seen_by[row, col] == len(seen)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), rule=st.sampled_from(["disjunctive", "conjunctive", "dempster"]))
def test_the_order_does_not_matter(seed, rule):
    rng = np.random.default_rng(seed)
    layers = [random_layer(rng) for _ in range(3)]
    expected = fuse(layers, rule)
    for order in itertools.permutations(layers):
        fusion = fuse(order, rule)
        np.testing.assert_allclose(fusion.grid.masses, expected.grid.masses, atol=1e-5)
        np.testing.assert_allclose(fusion.conflict, expected.conflict, atol=1e-5)
        np.testing.assert_array_equal(fusion.seen_by, expected.seen_by)


def test_a_contradiction_is_not_forgotten_before_the_third_map():
    layers = [grid("free"), grid("occupied"), grid("free")]
    for order in itertools.permutations(layers):
        assert tuple(fuse(order).grid.masses[0, 0]) == CERTAIN["unknown"]


def test_a_cell_only_one_robot_saw_keeps_its_evidence_unless_overlap_is_asked_for():
    left, right = grid("free", "occupied"), grid("occupied", "free", col=1)
    union, overlap = fuse([left, right]), fuse([left, right], coverage="overlap")
    np.testing.assert_array_equal(union.grid.masses[0], [CERTAIN["free"], CERTAIN["occupied"], CERTAIN["free"]])
    np.testing.assert_array_equal(overlap.grid.masses[0], [VACUOUS, CERTAIN["occupied"], VACUOUS])


def test_the_conjunctive_rule_keeps_its_conflict_and_dempster_does_not():
    doubtful_free, doubtful_wall = (0.0, 0.6, 0.0, 0.4), (0.0, 0.0, 0.5, 0.5)
    both = [grid(doubtful_free), grid(doubtful_wall)]
    assert fuse(both, "conjunctive").grid.masses[0, 0, CONFLICT] == pytest.approx(0.3)
    assert fuse(both, "dempster").grid.masses[0, 0, CONFLICT] == 0.0
    disjunctive = fuse(both, "disjunctive")
    assert disjunctive.grid.masses[0, 0, UNKNOWN] == pytest.approx(1.0)
    assert disjunctive.conflict[0, 0] == pytest.approx(0.3)  # known under every rule


def test_conflict_is_nothing_where_one_robot_alone_was():
    alone = grid((0.5, 0.25, 0.25, 0.0))
    assert fuse([alone]).conflict[0, 0] == 0.0
    np.testing.assert_array_equal(fuse([alone]).grid.masses, alone.masses)


def test_a_contradiction_inside_one_map_is_not_between_maps():
    torn, sure = grid((0.4, 0.6, 0.0, 0.0)), grid("free")
    assert fuse([torn, sure]).conflict[0, 0] == pytest.approx(0.0, abs=1e-6)


def test_two_halves_of_a_map_as_in_figure_2_of_the_paper():
    """51 % of the left and of the right: conjunction unites and sharpens, disjunction keeps the common strip."""
    whole = np.random.default_rng(5).dirichlet((1e-9, 1.0, 1.0, 1.0), size=(20, 100)).astype(np.float32)
    left, right = whole.copy(), whole.copy()
    left[:, 51:], right[:, :49] = VACUOUS, VACUOUS
    geometry = GridGeometry(0.1, 0.0, 0.0, 20, 100)
    halves = [TbmGrid(geometry, left), TbmGrid(geometry, right)]
    strip, rest = np.s_[:, 49:51], np.r_[0:49, 51:100]

    conjunctive = fuse(halves, "conjunctive", "union").grid.masses
    np.testing.assert_array_equal(conjunctive[:, rest], whole[:, rest])
    assert np.all(conjunctive[strip][..., UNKNOWN] <= whole[strip][..., UNKNOWN])
    surer_free = whole[strip][..., FREE] > whole[strip][..., OCCUPIED]
    assert np.all((conjunctive[strip][..., FREE] > conjunctive[strip][..., OCCUPIED]) == surer_free)

    disjunctive = fuse(halves, "disjunctive", "overlap").grid.masses
    assert np.all(disjunctive[:, rest] == VACUOUS)
    assert np.all(disjunctive[strip][..., UNKNOWN] >= whole[strip][..., UNKNOWN])
    np.testing.assert_allclose(disjunctive[strip][..., FREE], whole[strip][..., FREE] ** 2, atol=1e-6)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("cells", [1, 7 * 31, 10**6])
def test_grids_that_are_placed_fuse_as_if_they_were_drawn_however_many_rows_at_once(rule, cells, monkeypatch):
    rng = np.random.default_rng(8)
    masses = rng.dirichlet(np.ones(4), size=(3, 23, 17)).astype(np.float32)
    masses[rng.random(masses.shape[:3]) < 0.3] = VACUOUS
    grids = [TbmGrid(GridGeometry(0.1, 0.3, -1.0, 23, 17), one) for one in masses]
    poses = [SE2(0.4, 0.2, 0.7), SE2(-0.6, 0.1, -2.0)]
    lattice = grids[0].geometry
    drawn = [grids[0], *(warp(grid, pose, lattice) for grid, pose in zip(grids[1:], poses, strict=True))]
    expected = fuse(drawn, rule, reliabilities=[1.0, 0.9, 0.8])
    monkeypatch.setattr("merging.fusion._CELLS_AT_ONCE", cells)
    placed = [grids[0], *(place(grid, pose, lattice) for grid, pose in zip(grids[1:], poses, strict=True))]
    fusion = fuse(placed, rule, reliabilities=[1.0, 0.9, 0.8])
    assert fusion.grid.geometry == expected.grid.geometry
    assert fusion.grid.masses.tobytes() == expected.grid.masses.tobytes()
    assert fusion.conflict.tobytes() == expected.conflict.tobytes()
    np.testing.assert_array_equal(fusion.seen_by, expected.seen_by)


def test_nothing_to_fuse_is_refused():
    with pytest.raises(ValueError, match="windows must not be empty"):
        fuse([])


def test_many_maps_with_rounded_masses_still_give_beliefs():
    rounded = grid(*[tuple(np.array((0.0, 0.3, 0.2, 0.50005)))] * 3)
    for rule in ("disjunctive", "conjunctive", "dempster"):
        assert fuse([rounded] * 12, rule).grid.masses.sum(axis=-1) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(("reliabilities", "message"), [([0.5], "as many as layers"), ([0.5, 1.5], r"within \[0, 1\]")])
def test_reliabilities_that_mean_nothing_are_refused(reliabilities, message):
    with pytest.raises(ValueError, match=message):
        fuse([grid("free"), grid("free")], reliabilities=reliabilities)


def fusion(conflict):
    geometry = GridGeometry(0.1, 2.0, -1.0, *conflict.shape)
    return Fusion(TbmGrid.unknown(geometry), conflict.astype(np.float32), np.full(conflict.shape, 2, dtype=np.uint16))


def test_conflict_places_are_sorted_and_have_a_middle_and_an_area():
    conflict = np.zeros((30, 40))
    conflict[3, 4] = 0.9
    conflict[10:14, 20:22] = 0.5
    worst, other = conflict_places(fusion(conflict))
    assert (worst.x, worst.y) == pytest.approx((2.0 + 21 * 0.1, -1.0 + 12 * 0.1))
    assert (worst.area_m2, worst.conflict_m2) == pytest.approx((0.08, 0.04))
    assert (other.area_m2, other.conflict_m2) == pytest.approx((0.01, 0.009))
    assert conflict_places(fusion(conflict), count=1) == [worst]


def test_no_contradiction_has_no_place():
    assert conflict_places(fusion(np.full((5, 5), 0.05))) == []


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_keeps_as_many_numbers_of_a_cell_as_it_writes(rule):
    layer = grid((0.0, 0.6, 0.1, 0.3))
    kept = np.full((1, 1, 16), np.nan, dtype=np.float32)
    agreed, seen_by = np.empty((1, 1, 4), dtype=np.float32), np.zeros((1, 1), dtype=np.uint16)
    for _ in range(2):
        add_layer(RULES[rule].code, layer.masses, 1.0, kept, agreed, seen_by)
    assert np.flatnonzero(np.isfinite(kept[0, 0])).tolist() == list(range(RULES[rule].width))
