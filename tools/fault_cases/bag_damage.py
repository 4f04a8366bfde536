"""Ways to damage a bag file."""

import os
import sqlite3
from pathlib import Path

import numpy as np

from datasets.rosbag.source import BagSource
from datasets.salvage.ros1 import INDEX, next_record, record_at


def cut(path: Path, share: float) -> None:
    """Cut a file off after a share of it."""
    os.truncate(path, int(path.stat().st_size * share))


def drop_last_byte(path: Path) -> None:
    """Cut off a file's last byte."""
    os.truncate(path, path.stat().st_size - 1)


def zero(path: Path, share: float, size: int) -> None:
    """Write zeros into a file, after a share of it."""
    with path.open("r+b") as file:
        file.seek(int(path.stat().st_size * share))
        file.write(bytes(size))


def flip_bits(path: Path, number: int) -> None:
    """Turn bits anywhere behind a file's first page."""
    rng = np.random.default_rng(5)
    content = bytearray(path.read_bytes())
    for place in rng.integers(4200, len(content), number):
        content[place] ^= 1 << int(rng.integers(8))
    path.write_bytes(content)


def forget_index(path: Path) -> None:
    """Leave a ROS 1 bag as a recorder leaves it that is killed: without a pointer to its index."""
    content = path.read_bytes()
    place = content.index(b"index_pos=") + len("index_pos=")
    path.write_bytes(content[:place] + bytes(8) + content[place + 8 :])


def falsify_index(path: Path) -> None:
    """Let the first index record of a ROS 1 bag state a wrong length, as those of some bags of 2010 do."""
    content = bytearray(path.read_bytes())
    record = record_at(bytes(content), next_record(bytes(content), 0, (INDEX,)))
    if record is not None:
        content[record.start - 4 : record.start] = (record.end - record.start + 4).to_bytes(4, "little")
    path.write_bytes(content)


def spoil_definition(path: Path) -> None:
    """Make the definitions of another topic's messages unreadable."""
    path.write_bytes(path.read_bytes().replace(b"geometry_msgs/TwistWithCovariance twist", b"{}" + b"?" * 37))


def as_database(bag: Path, path: Path) -> None:
    """Write the messages of a ROS 2 bag as an sqlite database."""
    source = BagSource(bag)
    topics = {connection.topic: number for number, connection in enumerate(source.connections, 1)}
    types = {connection.topic: connection.msgtype for connection in source.connections}
    database = sqlite3.connect(path)
    with database:
        columns = "id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT"
        database.execute(f"CREATE TABLE topics({columns})")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        rows = [(number, topic, types[topic], "cdr", "") for topic, number in topics.items()]
        database.executemany("INSERT INTO topics VALUES(?, ?, ?, ?, ?)", rows)
        messages = source.messages(list(topics), "/base_scan")
        rows_of = ((topics[each.connection.topic], each.time, each.data) for each in messages)
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", rows_of)
    database.close()


def empty_database(path: Path) -> None:
    """Delete all messages of a database, which opens as well as before."""
    database = sqlite3.connect(path)
    with database:
        database.execute("DELETE FROM messages")
    database.close()
