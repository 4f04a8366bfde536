import pytest

from merging.alignment import Alignment
from merging.map_graph import groups_of
from tbmslam.se2 import SE2

POSES = {"a": SE2(0.0, 0.0, 0.0), "b": SE2(5.0, 1.0, 1.0), "c": SE2(-3.0, 2.0, -2.0), "d": SE2(9.0, 9.0, 3.0)}


def found(target, source, wall=10.0, accepted=True, T=None):
    motion = T or POSES[target].inverse() @ POSES[source]
    return {(target, source): Alignment("features", accepted, "", motion, agreed_wall_m=wall)}


def assert_poses(group, expected):
    assert list(group.poses) == list(expected)
    for name, pose in expected.items():
        assert group.poses[name] == pytest.approx(pose)


def test_a_chain_is_one_group_in_the_frame_of_the_first():
    groups = groups_of(list("abcd"), found("a", "c") | found("b", "c") | found("b", "d"))
    assert len(groups) == 1
    assert_poses(groups[0], POSES)


def test_refused_alignments_connect_nothing():
    groups = groups_of(list("ab"), found("a", "b", accepted=False))
    assert [list(group.poses) for group in groups] == [["a"], ["b"]]


def test_the_largest_group_comes_first_in_its_own_frame():
    groups = groups_of(list("abcd"), found("b", "c") | found("c", "d"))
    assert groups[0].first == "b"
    assert_poses(groups[0], {name: POSES["b"].inverse() @ POSES[name] for name in "bcd"})
    assert list(groups[1].poses) == ["a"]


def test_the_group_named_first_comes_first_among_equals():
    groups = groups_of(list("abcd"), found("c", "d") | found("a", "b"))
    assert [list(group.poses) for group in groups] == [["a", "b"], ["c", "d"]]


def test_the_best_alignments_make_the_tree():
    wrong = found("a", "c", wall=2.0, T=SE2(77.0, 0.0, 0.0))
    groups = groups_of(list("abc"), wrong | found("a", "b") | found("b", "c"))
    assert_poses(groups[0], {name: POSES[name] for name in "abc"})
