import pytest

from datasets.odometry.frames import FrameGraph, choose_frames, find_robot_frame, is_localised
from datasets.odometry.se3 import SE3
from datasets.options import RecordingOptions
from tbmslam.geometry.se2 import SE2
from tests.warnings_page import is_explained


def graph_of(*edges):
    """Edges (parent, child) move; (parent, child, pose) are static."""
    graph = FrameGraph()
    for parent, child, *pose in edges:
        for k in range(1 if pose else 3):
            motion = pose[0] if pose else SE2(float(k), 0.0, 0.0)
            graph.add(parent, child, SE3.from_planar(motion), bool(pose), 0.0)
    return graph


FIXED = SE2(0.1, 0.0, 0.0)
AUTO = RecordingOptions()


@pytest.mark.parametrize(
    ("edges", "odom", "robot"),
    [
        ([("odom", "base_link"), ("base_link", "laser", FIXED)], "odom", "base_link"),
        ([("map", "odom"), ("odom", "base_link"), ("base_link", "laser", FIXED)], "odom", "base_link"),
        (
            [("odom", "base_footprint"), ("base_footprint", "base_link", FIXED), ("base_link", "laser", FIXED)],
            "odom",
            "base_footprint",
        ),
        (
            [("odom", "base_link"), ("base_link", "base_footprint", FIXED), ("base_link", "laser", FIXED)],
            "odom",
            "base_link",
        ),
        ([("r1/odom", "r1/base_link"), ("r1/base_link", "laser", FIXED)], "r1/odom", "r1/base_link"),
        ([("start", "vehicle"), ("vehicle", "laser", FIXED)], "start", "vehicle"),
        ([("odom", "chassis"), ("chassis", "laser", FIXED)], "odom", "chassis"),
        ([("base_link", "odom"), ("base_link", "laser", FIXED)], "odom", "base_link"),
        ([("wheel_odom", "base_link"), ("base_link", "laser", FIXED)], "wheel_odom", "base_link"),
    ],
)
def test_frames_are_found(edges, odom, robot):
    frames = choose_frames(graph_of(*edges), "laser", AUTO)
    assert frames is not None
    assert (frames.odom, frames.robot) == (odom, robot)
    assert frames.to_sensor is not None


@pytest.mark.parametrize(
    "edges",
    [
        [],
        [("base_link", "laser", FIXED)],
        [("map", "base_link"), ("base_link", "laser", FIXED)],
        [("odom", "base_link", FIXED), ("base_link", "laser", FIXED)],
        [("camera", "tag")],
    ],
)
def test_without_motion_there_is_no_odometry(edges):
    assert choose_frames(graph_of(*edges), "laser", AUTO) is None


def test_a_laser_that_is_missing_in_tf():
    frames = choose_frames(graph_of(("odom", "base_link"), ("camera", "tag")), "laser", AUTO)
    assert frames is not None
    assert (frames.odom, frames.robot, frames.to_sensor) == ("odom", "base_link", None)


def test_frames_that_are_asked_for():
    graph = graph_of(("map", "base_link"), ("odom", "base_link"), ("base_link", "laser", FIXED))
    frames = choose_frames(graph, "laser", RecordingOptions(odom_frame="/map", robot_frame="/laser"))
    assert frames is not None
    assert (frames.odom, frames.robot, frames.to_sensor) == ("map", "laser", [])
    assert choose_frames(graph, "laser", RecordingOptions(odom_frame="nowhere")) is None


def test_a_path_may_go_up_and_down_the_tree():
    graph = graph_of(("base", "a", FIXED), ("base", "b", FIXED), ("b", "c", FIXED))
    path = graph.path("a", "c")
    assert path is not None
    assert [(step.edge.key, step.down) for step in path] == [
        (("base", "a"), False),
        (("base", "b"), True),
        (("b", "c"), True),
    ]
    assert graph.path("a", "z") is None


def test_the_robot_of_an_odometry_topic():
    graph = graph_of(("base_link", "laser", FIXED))
    assert find_robot_frame(graph, "laser", AUTO, "/base_link") == "base_link"
    assert find_robot_frame(graph, "laser", AUTO, "base_footprint") == "base_link"
    assert find_robot_frame(graph, "laser", RecordingOptions(robot_frame="x"), "base_link") == "x"
    assert find_robot_frame(FrameGraph(), "laser", AUTO, None) is None


@pytest.mark.parametrize("hint", [None, "unknown"])
def test_a_laser_in_the_frame_of_the_robot_itself_finds_it(hint):
    graph = graph_of(("base_link", "wheel", FIXED))
    assert find_robot_frame(graph, "base_link", AUTO, hint) == "base_link"


def test_localised_frames():
    assert is_localised("/map")
    assert is_localised("robot1/map")
    assert not is_localised("odom")


def test_a_duplicate_transform_causes_a_warning():
    moving = graph_of(("odom_combined", "base"), ("odom", "base"), ("map", "base"), ("base", "laser", FIXED))
    frames = choose_frames(moving, "laser", AUTO)
    (doubt,) = moving.doubts([*frames.to_robot, *frames.to_sensor])
    assert doubt == "tf places base in odom_combined and in odom; the former is used: pass --odom-frame if it is wrong"
    fixed = graph_of(("base", "laser", FIXED))
    steps = fixed.path("base", "laser")
    assert fixed.doubts(steps) == []
    fixed.add("base", "laser", SE3.from_planar(SE2(2.0, 0.0, 1.0)), True, 0.0)
    (doubt,) = fixed.doubts(steps)
    assert (
        doubt
        == "tf_static states several places of laser in base; the first is used: pass --sensor-pose if it is wrong"
    )
    assert is_explained(doubt)


@pytest.mark.parametrize(
    ("edges", "said"),
    [
        (
            [("odom", "base"), ("base", "laser", FIXED), ("bumper", "laser", FIXED), ("base", "bumper", FIXED)],
            "tf places laser in base and in bumper; the former is used: pass --sensor-pose if it is wrong",
        ),
        (
            [("odom", "base"), ("dock", "base", FIXED), ("base", "laser", FIXED)],
            "tf places base in odom and in dock; the former is used: pass --odom-frame if it is wrong",
        ),
    ],
)
def test_two_parents_of_one_frame_cause_a_warning(edges, said):
    graph = graph_of(*edges)
    frames = choose_frames(graph, "laser", AUTO)
    assert graph.doubts([*frames.to_robot, *frames.to_sensor]) == [said]
    assert is_explained(said)
