import json
import threading
import time

import numpy as np
import pytest

from datasets import DatasetError, RecordingOptions
from datasets.counts import ReadingCounts, Span
from datasets.recording import Recording, in_blocks, read_ahead, recording_warnings
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tests.warnings_page import is_explained


@pytest.mark.parametrize("number", [0, 1, 256, 257, 1000])
def test_blocks_hold_all_items_in_their_order(number):
    assert [item for block in in_blocks(range(number)) for item in block] == list(range(number))


def test_items_before_an_error_are_kept():
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
        "odd: 2 scans are stamped earlier than the scan before: the clock stepped back; "
        "2 gaps of 8.0 s in all without a scan, the longest 5.0 s"
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
        (
            {"angle_step_deg": 0.0},
            r"angle_step_deg must be between 0\.001 and 90 degrees in either direction, got 0\.0",
        ),
        ({"angle_step_deg": -721.0}, r"angle_step_deg must be between 0\.001 and 90 degrees .*, got -721\.0"),
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


def recording(description=None, **counts):
    made = Recording("r", lambda _: iter(()), description or {})
    made.counts = ReadingCounts(scans_read=100, scans_used=90, **counts)
    return made


def test_a_good_recording_has_no_warning():
    assert recording_warnings(recording(beams={"hit": 1000, "nan": 1}, description={"clock_warning": None})) == []


def test_every_fault_is_a_sentence():
    said = recording_warnings(
        recording(
            {
                "sensor_pose_known": False,
                "clock_warning": "the laser's clock is 82 s behind",
                "first_scan": {"angle_warning": "angles do not fit"},
            },
            dropped={"empty": 8, "something_new": 2},
            beams={"hit": 80, "nan": 20},
            backward_stamps=3,
            same_stamps=1,
            clock_disagreements=4,
            extrapolated=5,
            without_odometry=9,
            doubtful_sweeps=7,
            lost_scans=40,
            lost_seconds=8.0,
            beam_count_changes=6,
            pauses=[(1.0, 2.0), (5.0, 7.0)],
        )
    )
    assert said == [
        "8 of 100 scans were dropped: empty",
        "2 of 100 scans were dropped: something_new",
        "3 scans are stamped earlier than the scan before: the clock stepped back",
        "1 scan has the stamp of an earlier scan",
        "4 scans are stamped by another clock than the rest of the recording",
        "5 scans are beyond the odometry, at its end or at a long gap: it was extrapolated",
        "9 scans had no odometry, so scan matching alone estimated the motion",
        "7 scans state an impossible time between beams",
        "the number of beams changed 6 times",
        "about 40 scans, 8.0 s, lost in a damaged file",
        "20% of the beams are not a number",
        "2 gaps of 9.0 s in all without a scan, the longest 7.0 s: motion during a gap is unknown",
        "the mount of the laser on the robot is not recorded: a default was used",
        "the laser's clock is 82 s behind",
        "angles do not fit",
    ]


def test_every_warning_is_explained():
    reasons = ("before_odometry", "impossible_angles", "empty", "duplicate", "unreadable", "other_frame")
    made = recording(
        {"sensor_pose_known": False},
        dropped=dict.fromkeys(reasons, 2),
        beams={"hit": 1000, "nan": 100, "zero": 100, "too_close": 100},
        pauses=[(1.0, 2.0), (5.0, 7.0)],
        **dict.fromkeys(("backward_stamps", "same_stamps", "clock_disagreements", "extrapolated"), 2),
        **dict.fromkeys(("without_odometry", "doubtful_sweeps", "lost_scans", "beam_count_changes"), 2),
        farthest_m=8.0,
        farthest_beams=40,
        farthest_scans=10,
    )
    said = recording_warnings(made)
    assert len(said) == 6 + 9 + 3 + 2
    assert [warning for warning in said if not is_explained(warning)] == []
    assert not is_explained("the robot sings")


def test_a_gap_is_one():
    said = recording_warnings(recording(pauses=[(1.0, 3.0)]))
    assert said == ["1 gap of 3.0 s without a scan: motion during a gap is unknown"]


def test_stated_angles_cause_no_warning():
    assert recording_warnings(recording({"first_scan": {"angle_warning": "do not fit"}, "angle_step_deg": 1.0})) == []


def test_a_part_has_its_own_gaps_and_the_counts_of_the_whole():
    made = recording(dropped={"empty": 8}, beams={"hit": 80, "nan": 20})
    made.counts.add_gap(10.0, 3.0)
    made.counts.add_gap(50.0, 4.0)
    counted = [
        "in the whole recording, 8 of 100 scans were dropped: empty",
        "in the whole recording, 20% of the beams are not a number",
    ]
    assert recording_warnings(made, Span(60.0, 90.0)) == counted
    assert recording_warnings(made, Span(20.0, 60.0)) == [
        *counted,
        "1 gap of 4.0 s without a scan: motion during a gap is unknown",
    ]


def test_a_part_that_a_gap_ends_or_begins_has_not_seen_it():
    made = recording()
    made.counts.add_gap(10.0, 3.0)
    for part in (Span(0.0, 10.0), Span(13.0, 20.0)):
        assert recording_warnings(made, part) == []
        assert made.counts.incidents_in(part) == []
    assert len(made.counts.incidents_in(Span(0.0, 13.0))) == 1


def test_the_end_of_a_part_belongs_to_it():
    made = recording()
    made.counts.incidents.add(10.0, "the stamps of the scans step back")
    assert [len(made.counts.incidents_in(span)) for span in (Span(0.0, 10.0), Span(10.0, 20.0), Span(11.0, 20.0))] == [
        1,
        1,
        0,
    ]


def test_a_code_read_as_a_wall_is_reported_with_the_option():
    made = recording(beams={"hit": 1000}, farthest_m=8.0, farthest_beams=40, farthest_scans=10)
    said = (
        "40 beams end at exactly 8 m, the longest range of all, which may be a code for no return: try "
        "--no-return-code 8"
    )
    assert recording_warnings(made) == [said]
    assert "odd: 40 beams end at exactly 8 m, the longest" in made.counts.summary()


MOST_WAITING = 32 * 18  # blocks that wait, one that is being filled, one that waits for room


def reading(number):
    return Reading(LaserScan(float(number), 0.0, 0.1, 0.1, 30.0, np.ones(3)), None)


class Source:
    """Readings that note how many were read, by whom, and whether their source was closed."""

    def __init__(self, number, error=None):
        self.number, self.error = number, error
        self.read, self.closed, self.threads = 0, False, set()

    def __iter__(self):
        try:
            for number in range(self.number):
                self.read += 1
                self.threads.add(threading.current_thread().name)
                yield reading(number)
            if self.error is not None:
                raise self.error
        finally:
            self.closed = True


def nobody_reads():
    return not any(thread.name == "reading ahead" for thread in threading.enumerate())


@pytest.mark.parametrize("number", [0, 1, 31, 32, 33, 2000])
def test_the_same_readings_in_the_same_order(number):
    source = Source(number)
    assert [one.scan.stamp for one in read_ahead(source)] == list(range(number))
    assert source.closed
    assert source.threads <= {"reading ahead"}
    assert nobody_reads()


def test_what_waits_is_bounded():
    source = Source(100_000)
    readings = read_ahead(source)
    next(readings)
    before = -1
    while source.read > before:
        before = source.read
        time.sleep(0.1)
    assert 32 < source.read <= MOST_WAITING
    readings.close()
    assert source.closed
    assert nobody_reads()


def test_an_error_is_raised_after_the_earlier_readings():
    for error in (DatasetError("run.bag: the disk is gone"), MemoryError("no more")):
        seen = []
        with pytest.raises(type(error), match=str(error)):
            seen.extend(one.scan.stamp for one in read_ahead(Source(70, error)))
        assert seen == list(range(70))
        assert nobody_reads()


def test_a_reader_that_stops_early_does_not_wait():
    def interrupt(readings):
        for one in readings:
            if one.scan.stamp == 40.0:
                raise KeyboardInterrupt

    source = Source(5000)
    with pytest.raises(KeyboardInterrupt):
        interrupt(read_ahead(source))
    assert source.closed
    assert nobody_reads()


def test_ctrl_c_while_the_reader_begins_leaves_none(monkeypatch):
    begin = threading.Thread.start

    def interrupted(thread):
        begin(thread)
        raise KeyboardInterrupt

    source = Source(5000)
    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", interrupted)
        with pytest.raises(KeyboardInterrupt):
            next(read_ahead(source))
    assert nobody_reads()
