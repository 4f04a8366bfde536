import logging
import math

import numpy as np
import pytest

from merging import MergeConfig, merge
from merging.pose_priors import KnownPoseError, align_near, place_by_priors
from merging.rigid_alignment import prepared
from tbmslam.belief.grid import GridGeometry, TbmGrid
from tbmslam.belief.grid_resampling import resample
from tbmslam.belief.masses import FREE, UNKNOWN
from tbmslam.geometry.se2 import SE2
from tbmslam.map.tbm_map import TbmMap

TRUTH = SE2(-7.0, 30.0, math.radians(110.0))
"""Where the room's map lies in the other's frame."""
ROUGH = SE2(0.4, -0.5, math.radians(5.0))


@pytest.fixture
def maps(rooms):
    """Return a floor, its west half in a frame of its own, and another floor."""
    floor = rooms(1)
    half = TbmGrid(floor.geometry, floor.masses.copy())
    half.masses[:, 180:] = (0.0, 0.0, 0.0, 1.0)
    lattice = GridGeometry(0.05, -60.0, -60.0, 2400, 2400)
    turned = resample(half, TRUTH.inverse(), lattice).cropped_to_known()
    return {"floor": TbmMap(floor), "half": TbmMap(turned), "foreign": TbmMap(rooms(2))}


def corridor(cols):
    """A corridor of which no place is unlike another."""
    masses = np.zeros((60, cols, 4), dtype=np.float32)
    masses[..., FREE] = 1.0
    masses[[0, 1, -2, -1]] = (0.0, 0.0, 1.0, 0.0)
    return TbmMap(TbmGrid(GridGeometry(0.05, 0.0, 0.0, 60, cols), masses))


def known(**poses):
    return MergeConfig(known_poses={name: tuple(pose) for name, pose in poses.items()})


def about(pose, middle=(4.0, 6.0)):
    """A pose given half a metre and five degrees wrong, about the middle of what was seen."""
    there = SE2(*pose.inverse().apply(np.array(middle)), 0.0)
    return pose @ there @ ROUGH @ there.inverse()


def assert_near(found, true, metres=0.05, degrees=0.3):
    vx, vy, omega = (true.inverse() @ found).log()
    assert math.hypot(vx, vy) < metres
    assert abs(math.degrees(omega)) < degrees


def test_a_rough_pose_is_refined_and_the_reason_states_it(maps):
    config = known(half=about(TRUTH))
    found = place_by_priors(maps, config)
    assert list(found.poses) == ["floor", "half"]
    assert_near(found.poses["half"], TRUTH)
    one = found.alignments["floor", "half"]
    assert one.method == "prior"
    assert one.accepted
    assert one.confidence > 0.9
    assert "placed at the given pose, refined by 0.6" in one.reason
    assert "of wall agree (" in one.reason


def test_the_confirmation_of_an_exact_pose_is_stated(maps):
    exact = place_by_priors(maps, known(half=TRUTH)).alignments["floor", "half"].T_target_source
    reason = place_by_priors(maps, known(half=exact)).alignments["floor", "half"].reason
    assert reason.startswith("placed at the given pose, refined by 0.00 m and 0.0 degrees; ")


def test_what_is_known_is_not_searched_and_the_rest_is(maps):
    done = merge(maps, known(half=about(TRUTH)))
    assert list(done.poses) == ["floor", "half"]
    assert_near(done.poses["half"], TRUTH)
    assert done.alignments["floor", "half"].method == "prior"
    assert {done.alignments[pair].method for pair in (("floor", "foreign"), ("half", "foreign"))} == {"correlation"}
    assert list(done.left_out) == ["foreign"]


def test_a_self_similar_corridor_is_placed_at_its_known_pose():
    maps = {"long": corridor(600), "short": corridor(200)}
    assert merge(maps).merged is None
    done = merge(maps, known(short=(12.0, 0.3, 0.02)))
    assert list(done.poses) == ["long", "short"]
    assert_near(done.poses["short"], SE2(12.0, 0.0, 0.0), metres=0.3)
    assert done.alignments["long", "short"].confidence < 0.5


def test_where_maps_share_nothing_the_pose_stays_as_given(maps):
    apart = SE2(200.0, 0.0, 1.0)
    done = merge({name: maps[name] for name in ("floor", "half")}, known(half=apart))
    assert done.poses["half"] == pytest.approx(apart)
    assert "placed exactly at the given pose" in done.alignments["floor", "half"].reason


def test_a_map_is_placed_on_the_map_with_the_largest_overlap(maps):
    apart = SE2(200.0, 0.0, 1.0)
    shifted = TbmMap(maps["floor"].grid)
    three = {"half": maps["half"], "away": shifted, "near": maps["half"]}
    found = place_by_priors(three, known(away=apart, near=apart @ TRUTH))
    assert list(found.alignments) == [("half", "away"), ("away", "near")]
    assert_near(found.poses["near"], apart @ TRUTH)


def test_a_pose_that_walls_contradict_is_warned_of(maps, caplog):
    with caplog.at_level(logging.WARNING):
        done = merge({name: maps[name] for name in ("floor", "foreign")}, known(foreign=(2.0, 1.0, 0.3)))
    assert list(done.poses) == ["floor", "foreign"]
    assert "foreign: more of its walls contradict the given pose than confirm it: is it right?" in caplog.text


@pytest.mark.parametrize(("empty", "which"), [(0, "target"), (1, "source")])
def test_an_empty_map_lies_where_its_pose_says(maps, empty, which):
    config = MergeConfig()
    views = [prepared(maps["floor"].grid, 0.05, config)] * 2
    views[empty] = None
    found = align_near(*views, TRUTH, config)
    assert found.accepted
    assert found.T_target_source == TRUTH
    assert found.reason == f"placed at the given pose: the {which} map is empty"


@pytest.mark.parametrize(
    ("bare", "fact"),
    [
        (("floor",), "the target map holds no wall"),
        (("half",), "the source map holds no wall"),
        (("floor", "half"), "neither map holds a wall"),
    ],
)
def test_maps_without_a_wall_lie_where_its_pose_says(maps, bare, fact):
    lawn = TbmGrid.unknown(GridGeometry(0.05, 0.0, 0.0, 240, 320))
    lawn.masses[..., FREE], lawn.masses[..., UNKNOWN] = 1.0, 0.0
    two = {name: TbmMap(lawn) if name in bare else maps[name] for name in ("floor", "half")}
    done = merge(two, known(half=SE2(1.0, 2.0, 0.3)))
    assert done.poses["half"] == pytest.approx((1.0, 2.0, 0.3))
    assert done.alignments["floor", "half"].reason.startswith(f"placed at the given pose: {fact}; 0.0 m of wall agree")


@pytest.mark.parametrize("name", ["floor", "nobody"])
def test_a_pose_of_no_other_map_is_refused(maps, name):
    with pytest.raises(ValueError, match=f"known_poses must be of maps after the first, 'floor', got '{name}'"):
        merge(maps, known(**{name: (0.0, 0.0, 0.0)}))


def test_a_pose_so_far_off_that_the_merged_map_were_too_large_is_refused(maps):
    where = "half: at the given pose the merged map would be [0-9]+ x [0-9]+ m, .* cells, more than the 4e[+]08"
    with pytest.raises(KnownPoseError, match=where):
        merge(maps, known(half=(5000.0, -5000.0, 0.0)))


@pytest.mark.parametrize("pose", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (1e5, 0.0, 0.0), (0.0, 0.0, 1e4)])
def test_a_pose_that_nothing_has_is_no_parameter(pose):
    with pytest.raises(ValueError, match=r"known_poses\.half"):
        known(half=pose)
