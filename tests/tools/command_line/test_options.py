import argparse
import math

import pytest

from datasets import RecordingOptions
from tbmslam.geometry.se2 import SE2
from tools.command_line.options import LIVE, add_recording_options, add_viewer_option, options_from


def parse(*words):
    parser = argparse.ArgumentParser()
    add_recording_options(parser)
    return options_from(parser.parse_args(words))


def test_the_defaults_are_those_of_the_library():
    assert parse() == RecordingOptions()


def test_every_choice_has_an_option():
    words = (
        "--profile stata --scan-topic /s --laser-frame lf --odometry topic --odometry-topic /o --tf-topic /a "
        "--tf-topic /b --odom-frame of --robot-frame rf --sensor-pose 1 2 90 --no-upside-down --angle-step-deg 1 "
        "--range-min 0.1 --range-max 20 --range-offset -0.05 --cloud-heights 0.2 0.8 --no-return drop "
        "--no-return-code 8 --no-return-code 9 --odometry-scale 0.001 --clock-offset 82.2 --gap 3 --max-odometry-gap 4"
    )
    assert parse(*words.split()) == RecordingOptions(
        profile="stata",
        scan_topic="/s",
        laser_frame="lf",
        odometry="topic",
        odometry_topic="/o",
        tf_topics=("/a", "/b"),
        odom_frame="of",
        robot_frame="rf",
        sensor_pose=SE2(1.0, 2.0, math.pi / 2),
        upside_down=False,
        angle_step_deg=1.0,
        range_min=0.1,
        range_max=20.0,
        range_offset=-0.05,
        cloud_heights=(0.2, 0.8),
        no_return="drop",
        no_return_codes=(8.0, 9.0),
        odometry_scale=0.001,
        clock_offset=82.2,
        gap_s=3.0,
        max_odometry_gap_s=4.0,
    )


def test_a_value_that_cannot_be_meant():
    with pytest.raises(ValueError, match=r"range_min must not be negative, got -1\.0"):
        parse("--range-min", "-1")


@pytest.fixture
def grammar():
    made = argparse.ArgumentParser()
    made.add_argument("bags", nargs="+")
    add_viewer_option(made)
    return made


@pytest.mark.parametrize(
    ("words", "value"), [(["a.bag"], None), (["a.bag", "--viewer"], LIVE), (["a.bag", "--viewer", "b.rrd"], "b.rrd")]
)
def test_live_or_into_a_file(grammar, words, value):
    assert grammar.parse_args(words).viewer == value


def test_a_recording_is_not_taken_for_the_file(grammar, capsys):
    with pytest.raises(SystemExit):
        grammar.parse_args(["--viewer", "a.bag", "b.bag"])
    assert "--viewer: must end with .rrd, or be the last word for live viewing, got 'a.bag'" in capsys.readouterr().err
