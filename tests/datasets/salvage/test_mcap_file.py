"""MCAP files of other writers: compressed or not, in chunks or not."""

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from datasets.salvage.mcap_file import salvage_mcap


@pytest.fixture(params=[("NONE", True), ("NONE", False), ("LZ4", True), ("ZSTD", True)], ids=str)
def file(request, tmp_path):
    compression, use_chunking = request.param
    path = tmp_path / "run.mcap"
    writer = Writer(str(path), chunk_size=20_000, compression=CompressionType[compression], use_chunking=use_chunking)
    writer.start(profile="ros2")
    schema = writer.register_schema("a/msg/B", "ros2msg", b"int32 x")
    channel = writer.register_channel("/scan", "cdr", schema)
    for k in range(200):
        data = bytes([k % 256]) * 20 + bytes(range(256)) * 4
        writer.add_message(channel, log_time=10**9 * k, publish_time=0, data=data)
    writer.finish()
    return path


def test_all_messages_without_the_index(file):
    bag = salvage_mcap(file, "damaged")
    (connection,) = bag.connections
    assert connection[1:] == ("/scan", "a/msg/B", "", 200, False)
    read = [(time, data[0]) for _, time, data in bag.messages([connection], by_time=True)]
    assert read == [(10**9 * k, k % 256) for k in range(200)]
    assert bag.holes == ()


def test_damage_costs_what_lies_in_it(file):
    content = bytearray(file.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 60] = bytes(60)
    file.write_bytes(content)
    bag = salvage_mcap(file, "damaged")
    assert 100 <= len(bag.entries) <= 200
    file.write_bytes(content[: int(len(content) * 0.4)])
    assert 0 < len(salvage_mcap(file, "cut").entries) < 100


def test_a_changed_byte_costs_its_chunk(tmp_path):
    """Where the content could not be compressed, only the chunk's checksum tells that it is not what was written."""
    generator = np.random.default_rng(0)
    written = [generator.bytes(1000) for _ in range(40)]
    path = tmp_path / "run.mcap"
    writer = Writer(str(path), chunk_size=5_000, compression=CompressionType.LZ4)
    writer.start(profile="ros2")
    channel = writer.register_channel("/scan", "cdr", writer.register_schema("a/msg/B", "ros2msg", b"int32 x"))
    for k, data in enumerate(written):
        writer.add_message(channel, log_time=10**9 * k, publish_time=0, data=data)
    writer.finish()
    content = path.read_bytes()
    place = content.index(written[20]) + 500
    path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
    bag = salvage_mcap(path, "damaged")
    read = [data for _, _, data in bag.messages(bag.connections, by_time=True)]
    assert 30 <= len(read) < 40
    assert set(read) < set(written)
