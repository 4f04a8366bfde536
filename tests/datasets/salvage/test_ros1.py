import bz2

import lz4.frame
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datasets.salvage.ros1 import CHUNK, MESSAGE, decompressed, fields_of, next_record, record_at


def field(name, value):
    text = name + b"=" + value
    return len(text).to_bytes(4, "little") + text


def record(fields, data):
    header = b"".join(field(name, value) for name, value in fields.items())
    return len(header).to_bytes(4, "little") + header + len(data).to_bytes(4, "little") + data


def message(data, seconds=5):
    time = seconds.to_bytes(4, "little") + (7).to_bytes(4, "little")
    return record({b"conn": bytes(4), b"op": b"\x02", b"time": time}, data)


def test_a_record_is_read_where_it_begins():
    content = b"xyz" + message(b"content")
    found = record_at(content, 3)
    assert (found.op, found.time_ns(), found.number(b"conn")) == (MESSAGE, 5_000_000_007, 0)
    assert content[found.start : found.end] == b"content"


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xff\xff\xff" * 8,
        message(b"")[:-3],
        record({b"op": b"\x02"}, b""),
        record({b"op": b"\x63"}, b""),
        record({b"op": b"\x02", b"conn": b"\0", b"time": bytes(8)}, b""),
        record({b"conn": bytes(4)}, b""),
    ],
)
def test_what_is_no_record(content):
    assert record_at(content, 0) is None


def test_the_next_record_is_found_behind_damage():
    content = b"\x04\0\0\0op=\x02 damage" * 3 + message(b"a") + message(b"b")
    first = next_record(content, 0)
    assert record_at(content, first).start == len(content) - len(message(b"b")) - 1
    assert next_record(content, first + 1) == len(content) - len(message(b"b"))
    assert next_record(content, 0, (CHUNK,)) == len(content)
    assert next_record(b"nothing", 0) == 7


damages = st.lists(st.tuples(st.integers(0, 10_000), st.sampled_from([0, 4, 13, 255])), max_size=12)


@given(damages, st.integers(0, 200))
def test_the_next_record_is_the_first_place_where_one_begins(damage, position):
    content = bytearray(b"\0\0\0" + b"".join(message(bytes([k]) * 5) for k in range(6)))
    for place, value in damage:
        content[place % len(content)] = value
    content = bytes(content)
    begins = [place for place in range(position, len(content)) if record_at(content, place) is not None]
    assert next_record(content, position) == (begins[0] if begins else len(content))


def test_fields_must_fill_a_header():
    assert fields_of(field(b"a", b"1") + field(b"b", b"=2")) == {b"a": b"1", b"b": b"=2"}
    assert fields_of(field(b"a", b"1")[:-1]) is None
    assert fields_of((3).to_bytes(4, "little") + b"abc") is None


@pytest.mark.parametrize(("name", "compress"), [(b"bz2", bz2.compress), (b"lz4", lz4.frame.compress)])
def test_what_can_be_is_decompressed(name, compress):
    content = np.random.default_rng(0).bytes(2_000_000)  # several blocks
    data = compress(content)
    assert decompressed(data, name) == content
    part = decompressed(data[: len(data) * 3 // 4], name)
    assert 0 < len(part) < len(content)
    assert content.startswith(part)
    assert decompressed(b"no such data", name) == b""
    assert decompressed(data, b"zip") == b""
