"""Topics that hold the same scans: one is used, and it is said which."""

import numpy as np
import pytest

from datasets import DatasetError, RecordingOptions, open_recording
from datasets.recording import recording_warnings
from datasets.rosbag.files import BagFiles, Topic
from datasets.rosbag.messages import CLOUD_TYPE, SCAN_TYPE
from datasets.rosbag.republished import republished
from tests.warnings_page import is_explained


def copied(script, number=30, later=-0.3, latency=0.1, copies=1, **other):
    """Scans as a driver stamps them, and as a second node publishes them again, stamped `later`."""
    random = np.random.default_rng(0)
    for k in range(number):
        stamp, ranges = 100.0 + 0.2 * k, random.uniform(1.0, 9.0, 20)
        script.scan(stamp, ranges, topic="/scan")
        for copy in range(copies):
            topic, bag_time = f"/copy{copy or ''}", stamp + latency * (copy + 1)
            script.scan(stamp + later * (copy + 1), ranges, topic=topic, bag_time=bag_time, **other)
    return script.in_time_order()


def refused(bag):
    with pytest.raises(DatasetError, match="several LaserScan topics hold scans"):
        open_recording([bag])


@pytest.mark.parametrize(
    ("later", "used", "why"),
    [
        (-0.3, "/copy", "stamped 0.30 s earlier"),
        (0.3, "/scan", "stamped 0.30 s earlier"),
        (0.0, "/scan", "which were published first"),
    ],
)
def test_the_topic_with_the_earlier_stamps_is_used(script, tmp_path, caplog, later, used, why):
    bag = copied(script, later=later).write(tmp_path / "run.bag")
    recording = open_recording([bag])
    assert recording.description["scan_topic"] == used
    other = ({"/scan", "/copy"} - {used}).pop()
    said = f"{bag}: {used} and {other} hold the same scans: those of {used} are used, {why}"
    (line,) = [line for line in caplog.messages if "hold the same" in line]
    assert line == f"{said}; pass --scan-topic {other} for that topic"
    (stored,) = [warning for warning in recording_warnings(recording) if "hold the same" in warning]
    assert line == f"{bag}: {stored}"
    assert is_explained(stored)
    assert open_recording([bag], RecordingOptions(scan_topic=other)).description["scan_topic"] == other


def test_of_equal_stamps_the_scans_published_first_are_used(script, tmp_path):
    bag = copied(script, later=0.0, latency=-0.05).write(tmp_path / "run.bag")
    assert open_recording([bag]).description["scan_topic"] == "/copy"


def test_of_two_copies_the_earliest_is_used_and_both_others_are_named(script, tmp_path):
    files = BagFiles([copied(script, copies=2).write(tmp_path / "a.bag")])
    found = republished(files, [files.topics[name] for name in ("/scan", "/copy", "/copy1")])
    assert (found.best, found.others) == ("/copy1", ("/scan", "/copy"))
    assert found.later == pytest.approx(0.3)


def test_of_scans_with_equal_times_neither_was_first(script, tmp_path, caplog):
    bag = copied(script, later=0.0, latency=0.0).write(tmp_path / "run.bag")
    assert open_recording([bag]).description["scan_topic"] == "/copy"
    assert "those of /copy are used, with equal stamps; pass" in caplog.text


def test_of_equal_topics_the_longer_is_used(script, tmp_path):
    script.scan(120.0, (8.0, 9.0))
    bag = copied(script, later=0.0, latency=0.0).write(tmp_path / "run.bag")
    assert open_recording([bag]).description["scan_topic"] == "/scan"


@pytest.mark.parametrize("number", [120, 30])
def test_a_topic_with_a_fraction_of_the_scans_does_not_replace_them(script, tmp_path, number):
    copied(script, number=number)
    for k in range(20):
        script.scan(100.0 + 0.2 * (number + k), (1.0, 2.0, 3.0 + k), topic="/scan")
    refused(script.in_time_order().write(tmp_path / "run.bag"))


@pytest.mark.parametrize("unset", ["/copy", "/scan"])
def test_set_stamps_are_preferred_to_unset_ones(script, tmp_path, caplog, unset):
    random = np.random.default_rng(1)
    for k in range(30):
        ranges, stamp = random.uniform(1.0, 9.0, 20), 100.0 + 0.2 * k
        for topic in ("/copy", "/scan"):
            bag_time = stamp - 0.1 * (topic == unset)
            script.scan(0.0 if topic == unset else stamp, ranges, topic=topic, bag_time=bag_time)
    recording = open_recording([script.in_time_order().write(tmp_path / "run.bag")])
    used = ({"/scan", "/copy"} - {unset}).pop()
    assert recording.description["scan_topic"] == used
    assert f"those of {used} are used, whose stamps are set; pass" in caplog.text


@pytest.mark.parametrize(("msgtype", "counts"), [(CLOUD_TYPE, (30, 30)), (SCAN_TYPE, (9, 9)), (SCAN_TYPE, (100, 94))])
def test_topics_that_cannot_be_chosen_are_not_read(monkeypatch, msgtype, counts):
    monkeypatch.setattr(BagFiles, "messages", lambda *_: pytest.fail("messages are read"))
    topics = [Topic(f"/scan{number}", msgtype, count) for number, count in enumerate(counts)]
    assert republished(BagFiles([]), topics) is None


def test_a_scan_more_at_an_end_is_no_other_laser(script, tmp_path):
    more = copied(script).scan(99.0, (7.0, 8.0), topic="/copy").scan(120.0, (8.0, 9.0))
    bag = more.in_time_order().write(tmp_path / "run.bag")
    assert open_recording([bag]).description["scan_topic"] == "/copy"


@pytest.mark.parametrize("fault", [{"frame": "rear"}, {"number": 9}, {"later": -60.0}, {"latency": 60.0}])
def test_what_may_be_another_laser_is_asked_for(script, tmp_path, fault):
    refused(copied(script, **fault).write(tmp_path / "run.bag"))


def test_lasers_that_see_the_same_for_a_moment_are_two(script, tmp_path):
    copied(script, number=12)
    for k in range(30):
        script.scan(110.0 + 0.2 * k, (1.0, 2.0, 3.0 + k)).scan(110.0 + 0.2 * k, (2.0, 2.0, 3.0 + k), topic="/copy")
    refused(script.in_time_order().write(tmp_path / "run.bag"))


@pytest.mark.parametrize("ranges", [[np.inf], [0.0], [np.nan]])
def test_scans_that_show_nothing_are_no_evidence(script, tmp_path, ranges):
    for k in range(60):
        script.scan(100.0 + 0.1 * k, ranges * (k + 2)).scan(100.0 + 0.1 * k, ranges * (k + 2), topic="/rear")
    refused(script.write(tmp_path / "run.bag"))


def test_a_third_topic_of_another_laser_is_asked_for(script, tmp_path):
    copied(script)
    for k in range(30):
        script.scan(100.0 + 0.2 * k, (1.0, 2.0, 3.0 + k), topic="/rear")
    refused(script.in_time_order().write(tmp_path / "run.bag"))


def test_unset_stamps_are_compared_by_the_times_of_the_recording(script, tmp_path):
    random = np.random.default_rng(1)
    for k in range(30):
        ranges = random.uniform(1.0, 9.0, 20)
        script.scan(0.0, ranges, bag_time=100.0 + 0.2 * k).scan(0.0, ranges, topic="/copy", bag_time=99.9 + 0.2 * k)
    assert open_recording([script.in_time_order().write(tmp_path / "run.bag")]).description["scan_topic"] == "/copy"
