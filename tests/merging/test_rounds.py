import itertools
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.robot.drives import plan_drives
from merging import MergeConfig, align, merge
from merging.alignment import Alignment
from merging.joint_slam import redraw
from merging.map_graph.grouping import Group, groups_of
from merging.merge_state import MergeState
from merging.report.pair_cards import pair_cards
from merging.rounds import short_range_map, with_pairs_aligned, with_short_range_alignments
from tbmslam.belief.masses import FREE, OCCUPIED
from tbmslam.geometry.se2 import SE2
from tbmslam.io.map_folder import load_map
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor
from tests.merging.driven_map import map_of
from tests.merging.floors import maps_of_floors
from tools import build_maps
from tools.command_line.paths import map_folders

# One worker makes and merges the maps for all of them.
pytestmark = pytest.mark.xdist_group("rounds")

FLOORS = (1, 2, 3)
EVERY_FLOOR = {(f"{floor} left", f"{floor} right") for floor in FLOORS}


@pytest.fixture(scope="module")
def maps():
    return maps_of_floors(FLOORS)


def in_rounds(*neighbours, **more):
    retrieval = {"few": 2, "neighbours": neighbours}
    return MergeConfig.model_validate({"nonrigid": {"enabled": False}, "retrieval": retrieval, **more})


def aligned(maps, config, known=()):
    grouping = partial(groups_of, list(maps), config=config.graph, known=dict(known))
    return with_pairs_aligned(MergeState.of(maps, {}, grouping), config, Executor())


@pytest.fixture(scope="module")
def first(maps):
    """What one round finds in which each map is aligned with the map most like it."""
    return aligned(maps, in_rounds(1))


def test_few_maps_are_aligned_in_all_pairs(maps):
    some = {name: maps[name] for name in ("1 left", "1 right", "2 left")}
    assert list(aligned(some, MergeConfig()).alignments) == list(itertools.combinations(some, 2))


def test_methods_other_than_the_correlation_align_all_pairs(maps):
    assert len(aligned(maps, in_rounds(1, method="features")).alignments) == 15


def test_each_of_many_maps_is_aligned_with_the_map_most_like_it(maps, first):
    assert all(any(name in pair for pair in first.alignments) for name in maps)
    assert len(first.alignments) <= len(maps)
    assert first.alignments.keys() >= {("1 left", "1 right"), ("2 left", "2 right")}


def test_the_three_most_similar_maps_suffice_for_every_floor(maps):
    assert {pair for pair, found in aligned(maps, in_rounds(3)).alignments.items() if found.accepted} == EVERY_FLOOR


def test_further_rounds_align_what_may_join_groups_and_nothing_else(maps, first):
    more = aligned(maps, in_rounds(1, 5))
    joined = {name for group in first.groups if len(group) > 1 for name in group.poses}
    assert joined
    assert more.alignments.keys() > first.alignments.keys()
    for pair in more.alignments.keys() - first.alignments.keys():
        assert not first.are_joined(pair)
        assert joined & set(pair)  # two maps that fit nothing so far are strangers


def test_maps_of_known_poses_are_not_aligned_with_each_other(maps, first):
    right = first.group_of("1 left").poses
    known = {"1 left": right["1 left"], "1 right": right["1 right"]}
    some = {name: maps[name] for name in ("1 left", "1 right", "2 left", "3 left")}
    found = aligned(some, in_rounds(3), known).alignments
    assert set(found) == set(itertools.combinations(some, 2)) - {("1 left", "1 right")}


def test_a_map_that_is_similar_to_no_merged_map_is_reported(maps):
    found = merge(maps, in_rounds(1))
    assert set(found.poses) == {"1 left", "1 right"}
    assert "no merged map is similar to it" in found.left_out["2 left"]


CONFIG = MergeConfig()
ACES = Path(__file__).resolve().parents[2] / ".." / "shared/data/aces/aces.bag"
NEAR = CONFIG.short_range.range_m
T_WORLD_B = SE2(3.0, -2.0, 0.7)


def far_off(one, factor):
    """The same map by a laser that tells ranges wrong beyond what is near."""
    (drive,) = one.drives
    told = drive.keyframes.ranges
    wrong = np.where(told > NEAR, NEAR + (told - NEAR) * factor, told).astype(np.float32)
    keyframes = replace(drive.keyframes, ranges=wrong)
    return TbmMap(redraw([keyframes], one), (replace(drive, keyframes=keyframes),), one.provenance)


@pytest.fixture(scope="module")
def halls():
    world = make_world("halls", 3)
    ways = plan_drives(world, 2, length=45.0, overlap=0.7, seed=1)
    a, b = (map_of(world, way, 0.0, pose) for way, pose in zip(ways, (SE2.identity(), T_WORLD_B), strict=True))
    return {"a": far_off(a, 1.5), "b": far_off(b, 0.5)}


@pytest.fixture(scope="module")
def merged_halls(halls):
    return merge(halls, CONFIG)


def test_what_is_wrong_only_far_off_is_found_by_what_is_near(halls, merged_halls):
    first = align(halls["a"], halls["b"], CONFIG)
    assert not first.accepted, first.reason
    result = merged_halls
    found = result.alignments["a", "b"]
    assert found.accepted
    assert found.reason.startswith("with ranges up to 8.5 m: confidence ")
    # Exact to a centimetre where walls agree, from which the frame's origin is far.
    assert found.T_target_source == pytest.approx(T_WORLD_B, abs=0.04)
    # Optimised jointly, the drives follow distant hits as well, whose ranges are wrong by half.
    assert result.poses["b"] == pytest.approx(T_WORLD_B, abs=0.15)


def test_the_card_shows_the_short_range_maps(halls, merged_halls):
    result = merged_halls
    near = [short_range_map(one, NEAR).grid for one in halls.values()]
    assert [grid.geometry for grid in result.evidence_grids["a", "b"]] == [grid.geometry for grid in near]
    (card,), _ = pair_cards(result, halls, CONFIG)
    (as_they_are,), _ = pair_cards(replace(result, evidence_grids={}), halls, CONFIG)
    assert (
        card.pictures[0].caption
        == f"{as_they_are.pictures[0].caption} The picture shows the deformed or short-range maps that were compared."
    )
    assert card.pictures[0].png != as_they_are.pictures[0].png


def test_only_maps_of_different_groups_that_were_driven_are_looked_at(halls):
    world = make_world("halls", 4)
    stranger = map_of(world, plan_drives(world, 1, length=45.0, seed=1)[0], 0.0)
    others = {"picture": TbmMap(halls["b"].grid), "stranger": stranger}
    maps = {"a": halls["a"], "same": halls["a"], **others}
    nothing = Alignment("correlation", accepted=False, reason="", confidence=-1.0)
    first = dict.fromkeys(itertools.combinations(maps, 2), nothing)
    groups = [Group({"a": SE2.identity(), "same": SE2.identity()}), *(Group({n: SE2.identity()}) for n in others)]
    look = with_short_range_alignments(MergeState.of(maps, first, lambda _: groups), CONFIG, Executor())
    assert look.evidence_grids.keys() == {("a", "stranger"), ("same", "stranger")}
    assert {pair for pair, found in look.alignments.items() if found is not nothing} == look.evidence_grids.keys()
    assert not any(found.accepted for found in look.alignments.values())


def test_it_can_be_switched_off(halls):
    off = CONFIG.model_validate({**CONFIG.model_dump(), "short_range": {"enabled": False}})
    result = merge(halls, off)
    assert result.merged is None
    assert result.evidence_grids == {}


def test_hits_far_off_only_clear_the_way(halls):
    (drive,) = halls["a"].drives
    grid = short_range_map(halls["a"], 3.0).grid
    walls = grid.masses[..., OCCUPIED] > grid.masses[..., FREE]
    rows, cols = np.nonzero(walls)
    x = grid.geometry.origin_x + (cols + 0.5) * grid.geometry.resolution
    y = grid.geometry.origin_y + (rows + 0.5) * grid.geometry.resolution
    lasers = drive.keyframes.all_sensor_poses()[:, :2]
    distances = np.hypot(x[:, None] - lasers[:, 0], y[:, None] - lasers[:, 1]).min(axis=1)
    assert len(rows) > 100
    assert distances.max() < 3.1


@pytest.mark.slow
def test_without_it_a_map_of_a_real_drive_stays_out(tmp_path):
    if not ACES.exists():
        pytest.skip(f"{ACES.name} is absent: shared recordings are not part of the repository")
    assert build_maps.main([str(ACES), "--angle-step-deg", "1.0", "--robots", "8", "-o", str(tmp_path)]) == 0
    maps = {folder.name: load_map(folder) for folder in map_folders(tmp_path)}
    off = CONFIG.model_validate({**CONFIG.model_dump(), "short_range": {"enabled": False}})
    assert len(merge(maps, CONFIG).poses) > len(merge(maps, off).poses)
