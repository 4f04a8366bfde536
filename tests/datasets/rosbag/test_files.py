"""Damaged, foreign and odd bag files: one clear line, never a library's exception."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from rosbags import rosbag1
from rosbags.typesys import Stores, get_typestore

from datasets import DatasetError, RecordingOptions, open_recording
from tests.datasets.conftest import BagScript


def bag(path, start=100.0, far=3.0, scans=60, kind="none"):
    script = BagScript().drive(start, start + 0.1 * scans)
    for k in range(scans):
        script.scan(start + 0.1 * k, (1.0, 2.0, far + 0.01 * k))
    return script.in_time_order().write(path, kind)


@pytest.mark.parametrize(("kind", "ending"), [("none", ".bag"), ("sqlite3", "")])
def test_bags_of_two_robots_are_refused(tmp_path, kind, ending):
    paths = [bag(tmp_path / f"one{ending}", kind=kind), bag(tmp_path / f"two{ending}", 101.0, 5.0, kind=kind)]
    message = (
        rf"one{ending} and \S*two{ending} hold different scans of /scan from the same time: "
        "if they are of two robots, pass --separate, else give one of them"
    )
    with pytest.raises(DatasetError, match=message):
        open_recording(paths)


def test_parts_of_a_drive_and_a_bag_given_twice_are_one_recording(tmp_path):
    first = bag(tmp_path / "first.bag")
    again = tmp_path / "again.bag"
    shutil.copy(first, again)
    assert len(list(open_recording([first, again]))) == 60
    later = bag(tmp_path / "later.bag", 105.0)  # begins while the first still runs
    assert len(list(open_recording([first, later]))) == 120


def test_what_a_damaged_bag_spans_is_not_known(tmp_path):
    first, second = bag(tmp_path / "first.bag"), bag(tmp_path / "second.bag", far=5.0)
    second.write_bytes(second.read_bytes()[:-3000])
    assert open_recording([first, second]).expected_scans > 60


def short_drive(script):
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 103.0)
    for k in range(20):
        script.scan(100.5 + 0.1 * k, [1.0, 2.0 + 0.01 * k])
    return script.in_time_order()


def test_a_bad_definition_in_another_topic_does_no_harm(script, tmp_path):
    bag = short_drive(script).write(tmp_path / "good.bag")
    spoiled = tmp_path / "spoiled.bag"
    with rosbag1.Reader(bag) as reader, rosbag1.Writer(spoiled) as writer:
        writer.add_connection("/odd", "odd/msg/Odd", msgdef="this is { no definition\n===\nMSG: ?", md5sum="0" * 32)
        connections = {
            c.id: writer.add_connection(c.topic, c.msgtype, msgdef=c.msgdef.data, md5sum=c.digest)
            for c in reader.connections
        }
        for connection, time, raw in reader.messages():
            writer.write(connections[connection.id], time, raw)
    assert len(list(open_recording([spoiled]))) == 20


def test_a_type_that_only_bears_the_name_is_refused(tmp_path):
    with rosbag1.Writer(tmp_path / "odd.bag") as writer:
        connection = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", msgdef="int32 x", md5sum="1" * 32)
        writer.write(connection, 10**9, b"\0\0\0\0")
    with pytest.raises(DatasetError, match=r"odd\.bag: /scan is no standard sensor_msgs/msg/LaserScan \(checksum 1+"):
        open_recording([tmp_path / "odd.bag"])


def test_messages_that_cannot_be_decoded_are_counted(script, tmp_path):
    bag = short_drive(script).write(tmp_path / "good.bag")
    spoiled = tmp_path / "spoiled.bag"
    with rosbag1.Reader(bag) as reader, rosbag1.Writer(spoiled) as writer:
        connections = {
            c.id: writer.add_connection(c.topic, c.msgtype, msgdef=c.msgdef.data, md5sum=c.digest)
            for c in reader.connections
        }
        for number, (connection, time, raw) in enumerate(reader.messages()):
            cut = number % 7 == 3
            writer.write(connections[connection.id], time, raw[: len(raw) // 2] if cut else raw)
    recording = open_recording([spoiled])
    assert len(list(recording)) + recording.counts.dropped["unreadable"] == 20
    assert recording.counts.dropped["unreadable"] > 0


def test_a_bag_of_another_version_gets_one_line(shared_data):
    with pytest.raises(
        DatasetError, match=r"rosbag-v1\.2\.bag: a bag of version 'ROSRECORD V1\.2', only V2\.0"
    ) as caught:
        list(open_recording([shared_data / "broken" / "rosbag-v1.2.bag"]))
    assert "\n" not in str(caught.value)


def test_damaged_compressed_data(script, tmp_path):
    bag = short_drive(script).write(tmp_path / "run.bag", "bz2")
    content = bytearray(bag.read_bytes())
    place = content.index(b"BZh") + 200
    content[place : place + 50] = bytes(50)
    bag.write_bytes(content)
    with pytest.raises(DatasetError, match=r"run\.bag: the bag is damaged|run\.bag: cannot be read"):
        list(open_recording([bag]))


@pytest.mark.parametrize("kind", ["none", "bz2", "sqlite3", "mcap"])
def test_random_damage_never_leaks_a_library_exception(script, tmp_path, kind):
    bag = short_drive(script).write(tmp_path / "run.bag", kind)
    source = bag if bag.is_file() else next(path for path in bag.iterdir() if path.suffix != ".yaml")
    whole = source.read_bytes()
    rng = np.random.default_rng(3)
    for number in range(25):
        damaged = bytearray(whole)
        if number % 3 == 0:
            del damaged[int(rng.integers(20, len(damaged))) :]
        for place in rng.integers(16, len(damaged), 12):
            damaged[place] = int(rng.integers(256))
        path = Path(tmp_path / f"damaged{number}{source.suffix}")
        path.write_bytes(damaged)
        try:
            list(open_recording([path], RecordingOptions()))
        except DatasetError as error:
            assert "\n" not in str(error)  # noqa: PT017 - whether it is raised depends on the damage


def test_scans_of_which_none_can_be_decoded(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    with rosbag1.Writer(tmp_path / "run.bag") as writer:
        connection = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=store)
        writer.write(connection, 10**9, b"\1\2\3")
    with pytest.raises(DatasetError, match=r"run\.bag: no scan of /scan can be decoded: choose another --scan-topic"):
        open_recording([tmp_path / "run.bag"])
