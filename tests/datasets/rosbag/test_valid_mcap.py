"""MCAP files that lack what the format makes optional: each record of the index left out once."""

import logging

import numpy as np
import pytest
from mcap import records
from mcap.reader import make_reader
from mcap.writer import IndexType, Writer

from datasets import open_recording
from datasets.salvage.mcap_file import has_full_index

SCANS = 40
NO_CHUNK_INDEX = IndexType.ALL & ~IndexType.CHUNK
LEFT_OUT = {
    "nothing": {},
    "message index": {"index_types": IndexType.ALL & ~IndexType.MESSAGE},
    "message index, statistics": {"index_types": IndexType.ALL & ~IndexType.MESSAGE, "use_statistics": False},
    "chunk index": {"index_types": NO_CHUNK_INDEX},
    "chunk index, statistics": {"index_types": NO_CHUNK_INDEX, "use_statistics": False},
    "statistics": {"use_statistics": False},
    "channels": {"repeat_channels": False},
    "schemas": {"repeat_schemas": False},
    "channels, schemas": {"repeat_channels": False, "repeat_schemas": False},
    "summary offsets": {"use_summary_offsets": False},
    "checksums": {"enable_crcs": False},
    "chunks": {"use_chunking": False},
    "chunks, statistics": {"use_chunking": False, "use_statistics": False},
    "summary": {
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
    },
}


@pytest.fixture
def written(script, tmp_path):
    """Return a writer of one drive as an MCAP file that lacks something."""
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 105.0)
    for k in range(SCANS):
        script.scan(100.5 + 0.1 * k, np.full(181, 3.0), step=0.01)
    source = next(script.in_time_order().write(tmp_path / "whole", "mcap").glob("*.mcap"))

    def write(profile="ros2", order=1, **without):
        path = tmp_path / "run.mcap"
        writer = Writer(str(path), chunk_size=2000, **without)
        writer.start(profile=profile)
        channels = {}
        with source.open("rb") as file:
            messages = sorted(make_reader(file).iter_messages(), key=lambda item: order * item[2].log_time)
        for schema, channel, message in messages:
            if channel.id not in channels:
                own = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, own)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
        return path

    return write


def check(path, caplog):
    caplog.set_level(logging.WARNING)
    recording = open_recording([path])
    stamps = [reading.scan.stamp for reading in recording]
    np.testing.assert_allclose(stamps, 100.5 + 0.1 * np.arange(SCANS), atol=1e-6)
    assert recording.counts.lost_scans == 0
    assert caplog.text == ""


@pytest.mark.parametrize("left_out", LEFT_OUT)
def test_all_scans_are_read_without(written, left_out, caplog):
    check(written(**LEFT_OUT[left_out]), caplog)


def test_statistics_may_count_no_channel(written, monkeypatch, caplog):
    write = records.Statistics.write

    def write_without(statistics, stream):
        statistics.channel_message_counts.clear()
        write(statistics, stream)

    monkeypatch.setattr(records.Statistics, "write", write_without)
    check(written(), caplog)


@pytest.mark.parametrize("profile", ["", "own"])
def test_the_profile_is_free(written, profile, caplog):
    check(written(profile), caplog)


@pytest.mark.parametrize("chunks", [True, False])
def test_messages_may_come_in_any_order(written, chunks, caplog):
    check(written(order=-1, use_chunking=chunks), caplog)


@pytest.mark.parametrize("name", ["no_mi_nostat", "stat_without_counts"])
def test_files_of_other_writers(shared_data, name, caplog):
    caplog.set_level(logging.WARNING)
    recording = open_recording([shared_data / "mcap-valid" / f"{name}.mcap"])
    assert (len(list(recording)), recording.counts.lost_scans) == (1443, 0)
    assert "damage" not in caplog.text


def test_a_folder_is_read_through_where_one_file_needs_it(written, script, tmp_path, caplog):
    path = written(use_statistics=False)
    (tmp_path / "both").mkdir()
    path.rename(tmp_path / "both" / "both_0.mcap")
    for index in (SCANS, SCANS + 1):
        script.scan(100.5 + 0.1 * index, np.full(181, 3.0), step=0.01)
    script.messages = [one for one in script.messages if one[0] > 104.45 or one[1] == "/tf_static"]
    later = next(script.in_time_order().write(tmp_path / "later", "mcap").glob("*.mcap"))
    later.rename(tmp_path / "both" / "both_1.mcap")
    assert not has_full_index(tmp_path / "both" / "both_0.mcap")
    assert has_full_index(tmp_path / "both" / "both_1.mcap")
    assert len(list(open_recording([tmp_path / "both"]))) == SCANS + 2


def test_a_truncated_file_is_detected(written, caplog):
    path = written(**LEFT_OUT["summary"])
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert 0 < len(list(open_recording([path]))) < SCANS
    assert "the bag is damaged" in caplog.text
    assert "it is cut off" in caplog.text
