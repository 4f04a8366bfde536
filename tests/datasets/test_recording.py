import json

import pytest

from datasets import DatasetError, ReadingCounts, Recording, RecordingOptions
from datasets.recording import in_blocks
from tbmslam.geometry.se2 import SE2


@pytest.mark.parametrize("number", [0, 1, 256, 257, 1000])
def test_blocks_hold_all_items_in_their_order(number):
    assert [item for block in in_blocks(range(number)) for item in block] == list(range(number))


def test_what_comes_before_an_error_is_not_lost():
    def items():
        yield from range(300)
        raise DatasetError("damaged")

    blocks = in_blocks(items())
    assert next(blocks) + next(blocks) == list(range(300))
    with pytest.raises(DatasetError, match="damaged"):
        next(blocks)


def recording_of(**values):
    def stream(counts):
        for name, value in values.items():
            setattr(counts, name, value)
        return iter(())

    return Recording("run", stream, {})


def test_nothing_to_read_is_an_error():
    with pytest.raises(DatasetError, match="run: no scan in the recording: choose another with --scan-topic"):
        list(recording_of())


@pytest.mark.parametrize(
    ("reason", "remedy"),
    [
        ("empty", "none of their beams holds a range; check --range-min and --range-max"),
        ("before_odometry", "check --odometry, --odom-frame and --clock-offset"),
        ("impossible_angles", "pass --angle-step-deg"),
        ("unreadable", "pass --angle-step-deg if only the angle step is wrong, or choose another --scan-topic"),
        ("other_frame", "choose another --laser-frame or --scan-topic"),
    ],
)
def test_scans_of_no_use_say_what_to_do(reason, remedy):
    with pytest.raises(DatasetError, match=rf"run: none of 4 scans can be used \(.*3 {reason}.*\): {remedy}"):
        list(recording_of(scans_read=4, dropped={"duplicate": 1, reason: 3}))


def test_counts_as_text_and_as_json():
    counts = ReadingCounts(scans_read=10, scans_used=8, backward_stamps=2)
    counts.drop("empty")
    counts.drop("duplicate")
    counts.add_beams("hit", 90)
    counts.add_beams("no_return", 10)
    counts.add_beams("nan", 0)
    counts.add_gap(100.0, 3.0)
    counts.add_gap(110.0, 5.0)
    assert [incident.text(90.0) for incident in counts.incidents] == [
        "at 10.0 s: no scans, for 3.0 s",
        "at 20.0 s: no scans, for 5.0 s",
    ]
    assert counts.summary() == (
        "8 of 10 scans used, dropped: 1 duplicate, 1 empty; beams: 90.0 % hit, 10.0 % no_return\n"
        "odd: 2 backward stamps, 2 gaps of 8.0 s in all without a scan, the longest 5.0 s"
    )
    assert json.loads(json.dumps(counts.as_dict()))["dropped"] == {"duplicate": 1, "empty": 1}
    other = ReadingCounts()
    other.replace_by(counts)
    counts.drop("empty")
    assert other.dropped == {"duplicate": 1, "empty": 1}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"profile": "x"}, "profile must be one of auto, stata, got 'x'"),
        ({"odometry": "x"}, "odometry must be one of auto, tf, topic, none, got 'x'"),
        ({"no_return": "x"}, "no_return must be one of free, drop, got 'x'"),
        ({"range_max": 0.0}, r"range_max must be positive, got 0\.0"),
        ({"gap_s": -1.0}, r"gap_s must be positive, got -1\.0"),
        ({"max_odometry_gap_s": float("nan")}, "max_odometry_gap_s must be positive, got nan"),
        ({"range_min": -1.0}, r"range_min must not be negative, got -1\.0"),
        ({"angle_step_deg": 0.0}, r"angle_step_deg must be finite and not 0, got 0\.0"),
        ({"range_min": 5.0, "range_max": 2.0}, r"range_min must be below range_max, got 5\.0 and 2\.0"),
        ({"sensor_pose": SE2(float("nan"), 0.0, 0.0)}, "sensor_pose must be finite and within 1000 m, got"),
        ({"sensor_pose": SE2(1e300, 0.0, 0.0)}, "sensor_pose must be finite and within 1000 m, got"),
        ({"range_offset": float("nan")}, "range_offset must be within 10 m, got nan"),
        ({"odometry_scale": 0.0}, r"odometry_scale must be between 1e-6 and 1e6, got 0\.0"),
        ({"odometry_scale": float("nan")}, "odometry_scale must be between 1e-6 and 1e6, got nan"),
        ({"clock_offset": float("inf")}, "clock_offset must be finite, got inf"),
    ],
)
def test_options_that_cannot_be_meant(options, message):
    with pytest.raises(ValueError, match=message):
        RecordingOptions(**options)
