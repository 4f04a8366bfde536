import sqlite3

import pytest

from datasets.salvage.sqlite_file import salvage_sqlite


@pytest.mark.parametrize("page_size", [512, 4096, 65536])
def test_rows_of_any_length_are_read_as_sqlite_reads_them(tmp_path, page_size):
    path = tmp_path / "run.db3"
    rows = [(k, 1 + k % 2, 10**18 + k, bytes([k % 256]) * (k * 37 % 9000)) for k in range(1, 400)]
    with sqlite3.connect(path) as database:
        database.execute(f"PRAGMA page_size = {page_size}")
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        database.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        for number, name in ((1, "/scan"), (2, "/tf")):
            database.execute("INSERT INTO topics VALUES(?, ?, 'a/msg/B', 'cdr')", (number, name))
        database.executemany("INSERT INTO messages VALUES(?, ?, ?, ?)", rows)
    database.close()
    bag = salvage_sqlite(path, "damaged")
    assert [(c.topic, c.msgtype, c.msgcount) for c in bag.connections] == [
        ("/scan", "a/msg/B", 199),
        ("/tf", "a/msg/B", 200),
    ]
    read = [(connection.id, time, data) for connection, time, data in bag.messages(bag.connections, by_time=False)]
    assert read == [row[1:] for row in rows]
    assert bag.losses("/scan") == []


def test_what_is_no_database_gives_nothing(tmp_path):
    path = tmp_path / "run.db3"
    path.write_bytes(b"SQLite format 3\0" + bytes(range(256)) * 100)
    assert len(salvage_sqlite(path, "damaged").entries) == 0


def test_what_is_shorter_than_a_database_is_refused_as_any_damage_is(tmp_path):
    path = tmp_path / "run.db3"
    path.write_bytes(b"SQLite format 3\0" + bytes(10))
    with pytest.raises(ValueError, match="26 bytes are no database"):
        salvage_sqlite(path, "damaged")
