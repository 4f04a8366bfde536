import pytest

from datasets.synthetic.buildings import make_world
from datasets.synthetic.drives import plan_drives
from merging import MergeConfig, merge
from merging.aligner import align_whole
from merging.bent_maps import place_bent
from tbmslam.se2 import SE2
from tbmslam.tbm_map import TbmMap
from tests.merging.driven_map import map_of

LENGTH = 75.0
BEND = 0.004  # [rad/m]
T_WORLD_B = SE2(3.0, -2.0, 0.7)


@pytest.fixture(scope="module")
def straight_and_bent():
    world = make_world("office", 3)
    straight, bent = plan_drives(world, 2, length=LENGTH, overlap=0.9, seed=1)
    return map_of(world, straight, 0.0), map_of(world, bent, BEND, T_WORLD_B)


def test_a_map_too_bent_to_fit_as_a_whole_is_placed_in_stretches(straight_and_bent):
    straight, bent = straight_and_bent
    whole = align_whole(straight, bent)
    assert not whole.accepted, whole.reason
    found = place_bent(straight, bent, MergeConfig())
    assert found is not None
    assert found.alignment.accepted
    assert "stretches of the drive" in found.alignment.reason
    assert found.alignment.confidence >= 0.7
    assert align_whole(*map(TbmMap, found.grids)).agreement == pytest.approx(found.alignment.agreement, abs=0.05)

    result = merge({"b": bent, "a": straight})  # the one whose frame counts is the bent one
    assert list(result.poses) == ["b", "a"]
    assert result.alignments["b", "a"].accepted
    assert result.joint is not None
    for name, shown in zip("ba", result.judged_by["b", "a"], strict=True):  # each in its own frame
        own = {"a": straight, "b": bent}[name].grid.geometry
        assert shown.geometry[1:3] == pytest.approx(own[1:3], abs=3.0)  # but straight
    assert result.alignments["b", "a"].agreement > whole.agreement + 0.1
    straightened = align_whole(result.joint.maps["a"], result.joint.maps["b"])
    assert straightened.agreement > 0.8
    assert straightened.T_target_source == pytest.approx(SE2.identity(), abs=0.05)


def test_a_map_of_another_building_is_not(straight_and_bent):
    straight, _ = straight_and_bent
    world = make_world("office", 8)
    other = map_of(world, plan_drives(world, 1, length=LENGTH, seed=2)[0], BEND)
    assert place_bent(straight, other, MergeConfig()) is None


def test_maps_without_keyframes_or_with_one_stretch_are_not_tried(straight_and_bent):
    straight, bent = straight_and_bent
    assert place_bent(TbmMap(straight.grid), bent, MergeConfig()) is None
    assert place_bent(straight, TbmMap(bent.grid), MergeConfig()) is None
    short = MergeConfig.model_validate({"stretches": {"length_m": 2.0 * LENGTH}})
    assert place_bent(straight, bent, short) is None


def test_it_can_be_switched_off(straight_and_bent):
    straight, bent = straight_and_bent
    off = {"stretches": {"enabled": False}, "bent": {"enabled": False}}
    result = merge({"a": straight, "b": bent}, MergeConfig.model_validate(off))
    assert result.merged is None
