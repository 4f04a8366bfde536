"""Messages are those that rosbags finds by the same index, in whichever way their headers are written."""

import struct

import pytest
from rosbags import rosbag1

from datasets.rosbag.indexed_messages import IndexedMessages

TIME, OP = b"\x0d\0\0\0time=", b"\x04\0\0\0op=\x02"


@pytest.fixture
def bag(script, tmp_path):
    def written(kind="none"):
        script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 102.0)
        for number in range(20):
            script.scan(101.9 - 0.1 * number, [1.0, 2.0 + 0.01 * number], bag_time=100.0 + 0.05 * number)
        return script.write(tmp_path / f"{kind}.bag", kind)

    return written


def read(path, topics, *, by_rosbags=False, by_time=True):
    with rosbag1.Reader(path) as reader:
        connections = [connection for connection in reader.connections if connection.topic in topics]
        if by_rosbags:
            return [(connection.topic, time, bytes(data)) for connection, time, data in reader.messages(connections)]
        indexed = IndexedMessages(reader)
        found = indexed.by_time(connections) if by_time else indexed.in_order_of_writing(connections)
        return [(connection.topic, time, data) for connection, time, data in found]


@pytest.mark.parametrize("kind", ["none", "bz2", "lz4"])
@pytest.mark.parametrize("topics", [["/scan"], ["/tf", "/scan"], ["/scan", "/tf", "/tf_static"]])
def test_messages_by_time_are_those_of_rosbags(bag, kind, topics):
    path = bag(kind)
    assert read(path, topics) == read(path, topics, by_rosbags=True)


def test_messages_in_the_order_of_writing(bag):
    path = bag()
    found = read(path, ["/scan", "/tf"], by_time=False)
    by_place = [path.read_bytes().index(data) for _, _, data in found]
    assert by_place == sorted(by_place)
    assert sorted(found) == sorted(read(path, ["/scan", "/tf"], by_rosbags=True))


def with_headers(content, begin):
    """Return a bag's bytes, the fields of its messages' headers in another order; `begin` are those of one message."""
    connection = struct.unpack_from("<I", begin, begin.index(b"conn=") + 5)[0]
    field = b"\x09\0\0\0conn=" + struct.pack("<I", connection)
    place = content.index(begin)
    time = content[place + len(begin) : place + len(begin) + 8]
    return content.replace(begin + time, struct.pack("<I", 38) + TIME + time + field + OP)


def test_headers_that_are_written_otherwise_are_read_by_rosbags(bag):
    path = bag()
    content = path.read_bytes()
    sound = read(path, ["/scan", "/tf"])
    for begin in [
        struct.pack("<I", 38) + fields + TIME
        for number in range(3)
        for field in [b"\x09\0\0\0conn=" + struct.pack("<I", number)]
        for fields in (field + OP, OP + field)
    ]:
        while begin in content:
            content = with_headers(content, begin)
    assert content != path.read_bytes()
    path.write_bytes(content)
    assert read(path, ["/scan", "/tf"], by_rosbags=True) == sound
    assert read(path, ["/scan", "/tf"]) == sound


def test_an_index_that_points_elsewhere_is_an_error(bag):
    path = bag()
    with rosbag1.Reader(path) as reader:
        (connection,) = (each for each in reader.connections if each.topic == "/scan")
        first = reader.indexes[connection.id][0]
        reader.indexes[connection.id][0] = first._replace(time=first.time + 1)
        with pytest.raises(AssertionError):
            next(IndexedMessages(reader).by_time([connection]))


def test_steps_back_are_those_of_one_topic(bag):
    with rosbag1.Reader(bag()) as reader:
        indexed = IndexedMessages(reader)
        assert not indexed.steps_back(reader.connections, "/tf")
        assert not indexed.steps_back(reader.connections, "/scan")
