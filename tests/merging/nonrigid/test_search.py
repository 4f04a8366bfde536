import itertools
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.map_pairs.distortion import Distortion
from datasets.synthetic.map_pairs.pairs import building_of_world, cut_pairs, disjoint_pair
from datasets.synthetic.robot.drives import plan_drives
from merging import MergeConfig, align, merge
from merging.alignment import Alignment, deviations, format_confidence
from merging.map_graph.grouping import Group
from merging.merge_state import MergeState
from merging.nonrigid import search
from merging.nonrigid.deformation import DeformableMap, fit_tiles
from merging.nonrigid.search import deformable, register_nonrigid, register_pairs
from merging.rigid_alignment import align_prepared, align_whole, comparison_resolution
from merging.verification import examine
from merging.walls import WallMap
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap
from tbmslam.parallel.executor import Executor
from tests.merging.bent_floor import bent_maps, errors, found_of, rigid_of
from tests.merging.driven_map import map_of
from tools.benchmarks.strangers import make_pair
from tools.map_pairs.known_pair import KnownPair

REFUSED = Alignment("correlation", accepted=False, reason="it fits nowhere", lead=2.0)
RIGID = MergeConfig()
BENT = partial(Distortion.of_another_time, deformation_m=0.3)
OFF = MergeConfig.model_validate({"nonrigid": {"enabled": False}})


def agreement(target, source, motion, config=RIGID):
    """The share of the walls that agree under a motion."""
    structures = [WallMap.from_grid(one.grid, config.structure) for one in (target, source)]
    return examine(*structures, motion, config.verification).agreement


def register(target, source, config, refused=REFUSED):
    resolution = comparison_resolution([target.grid, source.grid], config)
    maps = (deformable(one.grid, resolution, config) for one in (target, source))
    return register_nonrigid(*maps, refused, config)


# The bent maps are made and aligned once for all of them.
pytestmark = pytest.mark.xdist_group("bent_maps")


def test_maps_that_fit_at_no_rigid_pose_are_aligned_by_deforming_one():
    _, source, true = bent_maps("store")
    whole = rigid_of("store")
    assert not whole.accepted, whole.reason
    found = found_of("store")
    assert found.accepted
    assert found.reason.startswith("one map was deformed by 0.")
    apart_m, apart_rad = errors(found.T_target_source, true, source)
    assert apart_m < 0.5
    assert apart_rad < np.radians(2.0)
    assert deviations(found.covariance)[0] > 0.1  # the pose of a deformed map is uncertain


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [0.95, 1.05])
def test_a_wrong_resolution_is_named(wrong, caplog):
    world = make_world("office", 3)
    first, second = (map_of(world, drive, 0.0) for drive in plan_drives(world, 2, length=75.0, overlap=0.9, seed=1))
    other = second.grid.geometry._replace(resolution=second.grid.geometry.resolution * wrong)
    result = merge({"a": first, "b": TbmMap(TbmGrid(other, second.grid.masses))})
    found = result.alignments["a", "b"]
    assert found.accepted, found.reason
    said = "larger: is the resolution of a map wrong?"
    larger, smaller = ("b", "a") if wrong > 1.0 else ("a", "b")
    assert said in found.reason
    assert any(line.startswith(f"{larger} is ") and f" % larger than {smaller}" in line for line in caplog.messages)
    percent = float(found.reason.partition("mostly because one map is ")[2].split()[0])
    assert percent == pytest.approx(5.0, abs=1.0)
    office = bent_pair("office", 4, 0.5, 1)  # one map is 4 % larger where they overlap, and bent as well
    for bent_target, bent_source, *_ in (bent_maps("store"), bent_maps("office"), (office.target, office.source)):
        assert said not in align(bent_target, bent_source).reason


def test_exchanged_maps_give_the_same_result():
    target, source, _ = bent_maps("store")
    forth, back = found_of("store"), align(source, target)
    assert forth.accepted
    assert forth.confidence == back.confidence
    assert forth.T_target_source.inverse() == pytest.approx(back.T_target_source, abs=1e-9)


def test_the_source_is_deformed_onto_the_target():
    target, source, true = bent_maps("office")
    rigid = merge({"a": target, "b": source}, OFF)
    assert rigid.merged is None
    result = merge({"a": target, "b": source})
    assert set(result.deformed) == {"b"}
    assert errors(result.poses["b"], true, source)[0] < 0.5
    straight, deformed = align_whole(target, result.deformed["b"]), (target, result.deformed["b"], result.poses["b"])
    assert straight.accepted
    stated = result.alignments["a", "b"].agreement
    assert stated == pytest.approx(agreement(*deformed, MergeConfig().of_deformed_maps()), abs=0.02)
    assert straight.agreement > agreement(target, source, result.poses["b"]) + 0.2
    assert errors(straight.T_target_source, result.poses["b"], source)[0] < 0.2
    assert result.evidence_grids["a", "b"][0] is target.grid
    assert result.evidence_grids["a", "b"][1] is result.deformed["b"].grid


def test_of_two_maps_with_keyframes_the_source_is_deformed_with_its_drive():
    world = make_world("office", 3)
    drives = plan_drives(world, 2, length=55.0, overlap=0.9, seed=1)
    straight, bent = map_of(world, drives[0], 0.0), map_of(world, drives[1], 0.004, SE2(3.0, -2.0, 0.7))
    result = merge({"a": straight, "b": bent})
    assert set(result.deformed) == {"b"}
    where = result.alignments["a", "b"].T_target_source
    assert agreement(straight, bent, where) < 0.6
    assert agreement(straight, result.deformed["b"], where) > 0.8
    assert result.joint is not None


def test_maps_of_two_buildings_are_not_aligned_by_deformation():
    target, _, _ = bent_maps("office")
    other, _, _ = bent_maps("store")
    assert register(target, other, MergeConfig()) is None


def test_ends_of_a_building_are_refused_although_deformation_makes_them_alike(monkeypatch):
    ends, attempts, attempt = make_pair("far ends", 234, 4901), [], search.attempt
    monkeypatch.setattr(search, "attempt", lambda *arguments: attempts.append(attempt(*arguments)) or attempts[-1])
    assert not align(ends.target, ends.source).accepted
    (passed,) = attempts
    assert passed is not None
    assert passed.tests.less_certain >= MergeConfig().verification.min_confidence
    assert passed.tests.agreeing_share < 0.65


def test_a_refused_pair_is_not_deformed_if_that_is_hardly_more_likely(monkeypatch):
    strangers = make_pair("unrelated", 678, 20261203)
    maps = strangers.target, strangers.source
    refused = align_whole(*maps)
    assert align(*maps) == refused
    assert not refused.accepted
    monkeypatch.setattr("merging.nonrigid.search._is_much_more_likely", lambda *_: True)
    found = register(*maps, MergeConfig(), refused)
    assert found is not None
    assert found.alignment.accepted


def test_a_refused_pair_stays_refused_unless_a_deformation_is_much_more_likely(monkeypatch):
    target, source, _ = bent_maps("store")
    rigid = rigid_of("store")
    monkeypatch.setattr("merging.nonrigid.search.DeformedRivals.of", lambda *_: pytest.fail("the attempt has ended"))
    monkeypatch.setattr("merging.nonrigid.search._MUCH_MORE_LIKELY", 1e300)
    assert align(target, source) == rigid


def test_the_reason_states_the_confidence_and_both_tests():
    found = found_of("store")
    assert f": confidence {format_confidence(found.confidence)}: confidence " in found.reason
    assert " among deformed rivals; after deformation: confidence " in found.reason


def test_a_pose_is_refused_if_deformed_rivals_fit_as_well(monkeypatch):
    ends = KnownPair.of(disjoint_pair(building_of_world("corridor", 4), 4, BENT))
    refused = align(ends.target, ends.source)
    assert not refused.accepted
    monkeypatch.setattr("merging.nonrigid.search.confidences", lambda *_, **__: [1.0])
    found = register(ends.target, ends.source, MergeConfig(), refused)
    assert found is not None
    assert found.alignment.accepted


def test_a_deformation_starts_at_a_likely_rigid_pose_too():
    likely, unlikely = (rigid_of(kind, 0.45) for kind in ("halls", "office"))
    assert not likely.accepted
    assert likely.confidence > 0.1
    assert len(likely.starts) == MergeConfig().nonrigid.places + 1
    assert likely.starts[-1].inverse() == pytest.approx(likely.T_target_source)  # the target has less wall
    assert not unlikely.accepted
    assert unlikely.confidence < 0.1
    assert len(unlikely.starts) == MergeConfig().nonrigid.places


def test_each_start_is_tried(monkeypatch):
    tried = []
    monkeypatch.setattr("merging.nonrigid.hypotheses.fit_tiles", lambda *arguments: tried.append(arguments[2]))
    target, source, _ = bent_maps("store")
    refused = replace(REFUSED, starts=(SE2(1.0, 2.0, 0.3), SE2(5.0, 0.0, 1.0)), lead=1.5)
    assert register(target, source, MergeConfig(), refused) is None
    assert tried == list(refused.starts)


@pytest.mark.parametrize(("accepted", "shift_m"), [(True, 0.0), (False, 0.0), (True, 3.0)])
def test_the_deformed_map_must_be_aligned_at_the_pose_without_an_initial_guess(monkeypatch, accepted, shift_m):
    target, source, _ = bent_maps("store")
    rigid = rigid_of("store")
    monkeypatch.setattr("merging.nonrigid.search.confidences", lambda *_, **__: [1.0])

    def aligned(here, there, config, _):
        found = align_prepared(here, there, config)
        assert found.accepted
        return replace(found, accepted=accepted, T_target_source=SE2(shift_m, 0.0, 0.0) @ found.T_target_source)

    monkeypatch.setattr("merging.nonrigid.search.align_prepared", aligned)
    found = register(target, source, MergeConfig(), rigid)
    assert (found is not None) == (accepted and shift_m == 0.0)


def test_a_map_that_tiles_register_roughly_is_aligned_by_larger_distances(monkeypatch):
    target, source, true = bent_maps("apartment", 0.9)
    found = register(target, source, MergeConfig())
    assert found is not None
    apart_m, apart_rad = errors(found.alignment.T_target_source, true, source)
    assert apart_m < 0.9
    assert apart_rad < np.radians(2.0)
    monkeypatch.setattr(MergeConfig, "of_deformed_maps", lambda config: config)
    assert register(target, source, MergeConfig()) is None


def test_refused_maps_are_registered_by_larger_distances_than_accepted_ones(monkeypatch):
    tried = set()

    def fitted(target, source, start, config):
        tried.add(config.verification.agreement_distance_m)
        assert config.refinement.last_reach_m == config.verification.agreement_distance_m
        assert config.verification.min_confidence == MergeConfig().verification.min_confidence

    accepted = rigid_of("store", 0.45)
    monkeypatch.setattr("merging.nonrigid.hypotheses.fit_tiles", fitted)
    target, source, _ = bent_maps("store")
    assert register(target, source, MergeConfig()) is None
    assert tried == {0.25}
    tried.clear()
    target, source, _ = bent_maps("store", 0.45)
    assert register(target, source, MergeConfig(), accepted) is None
    assert tried == {0.15}


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "turn"), [("far ends", 585), ("unrelated", 678)])
def test_larger_distances_favour_a_deformed_map_unless_the_rigid_one_has_them_too(monkeypatch, kind, turn):
    pair = make_pair(kind, turn, 20261203)
    assert not align(pair.target, pair.source).accepted
    rigid = align_whole(pair.target, pair.source).evidence
    monkeypatch.setattr("merging.nonrigid.search.evidence_near", lambda *_: rigid)
    assert align(pair.target, pair.source).accepted


def test_maps_without_known_cells_or_walls_are_not_tried():
    target, source, _ = bent_maps("store")
    empty = TbmMap(TbmGrid.unknown(GridGeometry(0.1, 0.0, 0.0, 300, 300)))
    bare = TbmMap(TbmGrid(empty.grid.geometry, np.tile(np.float32([0.0, 1.0, 0.0, 0.0]), (300, 300, 1))))
    for other in (empty, bare):
        assert register(target, other, MergeConfig()) is None
        assert register(other, source, MergeConfig()) is None


def closer(maps, groups, alignments, config=None, workers=1):
    found = MergeState.of(maps, alignments, lambda _: groups)
    return register_pairs(found, config or MergeConfig(), Executor(workers))


def test_any_number_of_workers_finds_the_same(caplog):
    caplog.set_level("INFO", logger="merging.nonrigid.search")
    target, source, _ = bent_maps("apartment", 0.9)
    maps = {"a": target, "b": source, "c": bent_maps("store")[0]}
    groups = [Group({name: SE2.identity()}) for name in maps]
    refused = dict.fromkeys(itertools.combinations(maps, 2), REFUSED)
    one, two = (closer(maps, groups, refused, workers=workers) for workers in (1, 2))
    assert [record.message.partition(":")[0] for record in caplog.records] == ["b in a"] * 2
    assert list(one) == list(two) == [("a", "b")]
    assert one["a", "b"].alignment == two["a", "b"].alignment


def test_an_accepted_pair_is_deformed_if_that_is_much_more_likely():
    """The rigid pose fits one end of the store, and is turned by more than two degrees."""
    target, source, true = bent_maps("store", 0.45)
    rigid, found = rigid_of("store", 0.45), found_of("store", 0.45)
    assert rigid.accepted
    assert errors(rigid.T_target_source, true, source)[1] > np.radians(2.0)
    assert errors(found.T_target_source, true, source)[1] < np.radians(1.5)
    assert found.agreement > rigid.agreement + 0.2
    assert found.bent_m > 0.1
    assert found.confidence == rigid.confidence
    assert found.reason.startswith("one map was deformed by 0.")
    assert found.reason.endswith(f"without deformation: {rigid.reason}")
    assert deviations(found.covariance)[1] > 4.0 * deviations(rigid.covariance)[1]
    assert align(source, target).T_target_source.inverse() == pytest.approx(found.T_target_source, abs=1e-9)
    assert align(target, source, OFF) == rigid


def test_an_accepted_pair_that_fits_stays_rigid(rooms):
    part = rooms(3)
    part.masses[:, 200:] = (0.0, 0.0, 0.0, 1.0)
    pair = TbmMap(rooms(3)), TbmMap(part)
    assert align(*pair) == align_whole(*pair)


def test_an_accepted_pair_stays_rigid_unless_a_deformation_is_much_more_likely(monkeypatch):
    target, source, _ = bent_maps("store", 0.45)
    rigid = rigid_of("store", 0.45)
    monkeypatch.setattr("merging.nonrigid.search._MUCH_MORE_LIKELY", 1e300)
    assert align(target, source) == rigid


def bent_pair(kind, seed, overlap, number):
    """Return two maps of a floor, each bent by 0.3 m, that share a part of it."""
    return KnownPair.of(next(cut_pairs(building_of_world(kind, seed), number, [overlap], BENT)))


def test_maps_that_fit_well_are_deformed_if_they_then_fit_better():
    """The probability of either pose rounds to 1."""
    _, source, true = bent_maps("store", 0.2)
    rigid, found = rigid_of("store", 0.2), found_of("store", 0.2)
    assert rigid.accepted
    assert found.bent_m > 0.1
    assert found.agreement > rigid.agreement + 0.05
    assert errors(found.T_target_source, true, source)[0] < errors(rigid.T_target_source, true, source)[0]


def test_a_rigid_pose_that_fits_a_part_of_the_overlap_needs_the_pose_of_the_correlation(monkeypatch):
    pair = bent_pair("apartment", 4, 0.5, 6)
    rigid = align_whole(pair.target, pair.source)
    assert not pair.is_right(rigid.T_target_source)
    found = register(pair.target, pair.source, MergeConfig(), rigid)
    assert pair.is_right(found.alignment.T_target_source)
    monkeypatch.setattr("merging.nonrigid.search.same_place", lambda motions, *_: motions * (len(motions) == 1))
    alone = register(pair.target, pair.source, MergeConfig(), rigid)
    assert not pair.is_right((alone.alignment if alone else rigid).T_target_source)


def test_a_refused_pair_with_a_likely_rigid_pose_is_deformed_although_no_pose_stands_out(monkeypatch):
    pair = bent_pair("store", 0, 0.35, 3)
    rigid = align_whole(pair.target, pair.source)
    assert not rigid.accepted
    assert rigid.lead < MergeConfig().nonrigid.min_lead
    found = register(pair.target, pair.source, MergeConfig(), rigid)
    assert found is not None
    assert found.alignment.accepted
    assert pair.is_right(found.alignment.T_target_source)
    monkeypatch.setattr("merging.nonrigid.search.WORTH_DEFORMING", 1.0)
    assert register(pair.target, pair.source, MergeConfig(), rigid) is None


def test_a_map_that_one_alignment_joins_is_deformed_in_the_merged_map():
    target, source, true = bent_maps("store", 0.45)
    result = merge({"a": target, "b": source})
    found = result.alignments["a", "b"]
    assert found == found_of("store", 0.45)
    assert set(result.deformed) == {"b"}
    assert errors(result.poses["b"], true, source)[1] < np.radians(1.5)
    straight = agreement(target, result.deformed["b"], result.poses["b"])
    assert straight == pytest.approx(found.agreement, abs=0.02)
    assert straight > agreement(target, source, result.poses["b"]) + 0.2
    assert result.evidence_grids["a", "b"][1] is result.deformed["b"].grid


def test_accepted_pairs_are_tried_only_if_they_alone_join_a_map(monkeypatch):
    tried = []
    monkeypatch.setattr(
        "merging.nonrigid.search._register_accepted", lambda *arguments: tried.append(arguments[2].reason)
    )
    target, source, _ = bent_maps("store")
    maps = {"a": target, "b": source, "c": target, "d": source}
    pairs = [("a", "b"), ("b", "c"), ("a", "c"), ("c", "d")]
    group = Group(dict.fromkeys(maps, SE2.identity()), tuple(pairs))
    alignments = {pair: replace(REFUSED, accepted=True, reason="-".join(pair)) for pair in pairs}
    assert closer(maps, [group], alignments) == {}
    assert tried == ["c-d"]
    tried.clear()
    assert closer(maps, [group], {pair: replace(found, method="prior") for pair, found in alignments.items()}) == {}
    assert closer(maps, [group], alignments, OFF) == {}
    assert tried == []


def test_joined_and_accepted_pairs_are_not_tried():
    target, source, _ = bent_maps("store")
    maps, pair = {"a": target, "b": source}, ("a", "b")
    together, apart = [Group(dict.fromkeys("ab", SE2.identity()))], [Group({name: SE2.identity()}) for name in "ab"]
    assert closer(maps, together, {pair: REFUSED}) == {}
    assert closer(maps, apart, {pair: replace(REFUSED, accepted=True)}) == {}
    assert closer(maps, apart, {pair: REFUSED}, OFF) == {}
    assert closer(maps, apart, {pair: replace(REFUSED, lead=1.04)}) == {}  # no pose stands out in the correlation


def test_the_map_is_deformed_where_it_fits_best_afterwards():
    """The first pose of the correlation is elsewhere, and tiles fit there, too."""
    target, source, true = bent_maps("store")
    fixed, moving = (DeformableMap.of(one.grid, MergeConfig()) for one in (source, target))  # the target has less wall
    refused = rigid_of("store")
    right, *others = sorted(refused.starts, key=lambda pose: errors(pose, true.inverse(), target)[0])
    assert errors(right, true.inverse(), target)[0] < 1.0
    wrong = next(pose for pose in others if fit_tiles(fixed.structure, moving, pose, MergeConfig()))
    last, alone = (replace(refused, starts=starts) for starts in ((wrong, right), (wrong,)))
    found = register(target, source, MergeConfig(), last)
    assert found is not None
    assert errors(found.alignment.T_target_source, true, source)[0] < 0.5
    assert register(target, source, MergeConfig(), alone) is None
