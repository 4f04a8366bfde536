"""Databases whose recorder was killed: half of the drive is in a file beside them."""

import gzip
import os
import shutil
import sqlite3

import numpy as np
import pytest

from datasets import DatasetError, open_recording
from datasets.opening import file_digests, list_recordings
from datasets.rosbag.bag_files import log_of
from datasets.rosbag.write_ahead_log import with_log
from tests.warnings_page import is_explained

SCANS = 100


@pytest.fixture
def bag(script, tmp_path):
    """A ROS 2 bag of a 10 s drive, whose second half is in the log."""
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 111.0)
    for k in range(SCANS):
        script.scan(100.5 + 0.1 * k, np.full(50, 3.0 + 0.01 * k), step=0.01)
    folder = script.in_time_order().write(tmp_path / "run", "sqlite3")
    interrupt(folder / "run.db3", tmp_path / "recorder.db3")
    return folder


def interrupt(file, work):
    """Leave the later half of the messages of a database in its log."""
    shutil.move(file, work)
    recorder = sqlite3.connect(work)
    recorder.execute("PRAGMA journal_mode=WAL")
    recorder.execute("PRAGMA wal_autocheckpoint=0")
    rows = recorder.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp").fetchall()
    recorder.execute("DELETE FROM messages")
    recorder.commit()
    for half in (rows[: len(rows) // 2], rows[len(rows) // 2 :]):
        recorder.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        recorder.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", half)
        recorder.commit()
    shutil.copy(work, file)
    shutil.copy(f"{work}-wal", f"{file}-wal")
    recorder.close()


def contents(folder):
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("given", ["folder", "file", "folder without metadata.yaml"])
def test_the_messages_of_the_log_are_read(bag, caplog, given):
    if "without" in given:
        (bag / "metadata.yaml").unlink()
        shutil.copy(bag / "run.db3-wal", bag / "run.db3-shm")  # whatever it holds
    before = contents(bag)
    (path,) = list_recordings([bag if "folder" in given else bag / "run.db3"])
    assert path == (bag if "folder" in given else bag / "run.db3")
    recording = open_recording([path])
    assert len(list(recording)) == SCANS
    assert len(list(recording)) == SCANS
    assert contents(bag) == before
    warning = next(text for text in caplog.messages if "-wal" in text)
    assert warning == f"{bag / 'run.db3'}: its recorder did not close it, and the rest was read from run.db3-wal"
    assert is_explained(warning)


def test_each_file_of_a_bag_has_its_own_log(bag, script, tmp_path):
    later = script.__class__()
    later.tf(120.0, "base_link", "laser", topic="/tf_static").drive(120.0, 123.0)
    for k in range(20):
        later.scan(120.5 + 0.1 * k, np.full(50, 3.0 + 0.02 * k), step=0.01)
    shutil.move(later.in_time_order().write(tmp_path / "later", "sqlite3") / "later.db3", bag / "run_1.db3")
    (bag / "metadata.yaml").unlink()
    assert len(list(open_recording([bag]))) == SCANS + 20


def test_a_log_without_content_is_none(bag):
    log = bag / "run.db3-wal"
    assert log_of(bag / "run.db3") == log
    log.write_bytes(b"")
    assert log_of(bag / "run.db3") is None
    assert with_log(bag / "run.db3").path == bag / "run.db3"


def test_a_log_of_no_use_leaves_the_file_as_it_is(bag, caplog):
    (bag / "run.db3-wal").write_bytes(b"no log" * 100)
    assert 0 < len(list(open_recording([bag / "run.db3"]))) < SCANS
    assert "its recorder did not close it, and run.db3-wal does not fit it (no whole page)" in caplog.text
    content = bytearray((bag / "run.db3").read_bytes())
    content[:4096] = b"SQLite format 3\0" + bytes(4080)
    (bag / "run.db3").write_bytes(content)
    note = with_log(bag / "run.db3").note
    assert note.startswith("its recorder did not close it, and run.db3-wal does not fit it (")
    assert is_explained(note)


def test_without_room_for_the_copy_the_remedy_is_told(bag, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(DatasetError, match=r"run\.db3: cannot be copied into .* \(No space .*\): make room"):
        open_recording([bag / "run.db3"])


def test_the_log_is_part_of_the_input(bag):
    assert [each["name"] for each in file_digests([bag / "run.db3"])] == ["run.db3", "run.db3-wal"]


def test_the_log_of_a_packed_file_is_not_used(bag):
    packed = bag / "run.db3.gz"
    packed.write_bytes(gzip.compress((bag / "run.db3").read_bytes()))
    assert 0 < len(list(open_recording([packed]))) < SCANS


@pytest.mark.parametrize("given", ["folder", "file"])
def test_a_cut_database_beside_a_log_of_no_use_is_salvaged(bag, caplog, given):
    file = bag / "run.db3"
    whole = file.stat().st_size
    os.truncate(file, whole - 3 * 4096)
    (bag / "run.db3-wal").write_bytes(b"no log" * 100)
    assert 0 < len(list(open_recording([bag if given == "folder" else file]))) < SCANS
    assert f"{file}: the database is cut off, {whole - 3 * 4096} of {whole} bytes are there" in caplog.text
    (note,) = (text for text in caplog.messages if "-wal" in text)
    assert note.startswith(f"{file}: its recorder did not close it, and run.db3-wal does not fit it (")
    assert note.endswith(")")


def test_scans_that_the_recorder_announced_are_missed_beside_a_log_too(bag, caplog):
    description = bag / "metadata.yaml"
    written = description.read_text()
    assert written.count(f"message_count: {SCANS}\n") == 1
    description.write_text(written.replace(f"message_count: {SCANS}\n", f"message_count: {SCANS + 50}\n"))
    recording = open_recording([bag])
    assert len(list(recording)) == SCANS
    assert recording.counts.lost_scans == 50
    assert f"{bag}: 50 of {SCANS + 50} scans that it announces are missing" in caplog.messages
    assert "seems to be lost" not in caplog.text


def test_scans_that_another_bag_announced_are_missed_beside_a_log_too(bag, script, tmp_path, caplog):
    later = script.__class__().drive(120.0, 123.0)
    for k in range(20):
        later.scan(120.5 + 0.1 * k, np.full(50, 3.0 + 0.02 * k), step=0.01)
    other = later.in_time_order().write(tmp_path / "later", "sqlite3")
    description = other / "metadata.yaml"
    description.write_text(description.read_text().replace("message_count: 20\n", "message_count: 30\n"))
    assert len(list(open_recording([bag, other]))) == SCANS + 20
    assert f"{bag}: 10 of {SCANS + 30} scans that it announces are missing" in caplog.messages
