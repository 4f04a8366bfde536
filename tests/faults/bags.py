"""Damaged bags: everything readable is used, and what was lost is said; or one clear line."""

import os
import re
import sqlite3
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from datasets.rosbag.source import BagSource
from datasets.salvage.ros1 import INDEX, next_record, record_at
from datasets.salvage.salvaged_bag import UNKNOWN_LOSS
from tests.faults.fault_case import FaultCase, Outcome, mapped, shortened, simulated


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


def write_as_database(bag: Path, path: Path) -> None:
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


_ROS1, _BZ2 = (), ("--compression", "bz2")
_MCAP = ("--format", "mcap")


def _tried(
    folder: Path, kind: tuple[str, ...], damage: Callable[[Path], None], least: float, *, as_database: bool = False
) -> Outcome:
    """Damage a bag and map it: at least a share of its scans must be used, and those lost be said."""
    bag = simulated(folder / "drive", *kind)
    scans = len((folder / "drive" / "robot_0.truth.tum").read_text(encoding="utf-8").splitlines())
    if as_database:
        write_as_database(bag, folder / "robot_0.db3")
        bag = folder / "robot_0.db3"
    damage(next(bag.glob("*.mcap")) if bag.is_dir() else bag)
    if kind == _MCAP and bag.is_dir() and least < 1.0:
        (bag / "metadata.yaml").unlink(missing_ok=True)
    done, run = mapped(bag, folder / "maps")
    if done.code or not run:
        return Outcome(f"exit {done.code}: {done.stderr.strip()[-100:]}", "everything", survived=False)
    counts = run["counts"]
    used, lost = counts["scans_used"], counts["lost_scans"]
    told = UNKNOWN_LOSS if UNKNOWN_LOSS in done.stderr else ""
    said = told or _first(r"(the bag |the index|the database|no metadata)[^;(]*", done.stderr)
    happened = f"{used} of {scans} scans used" + (f"; {said}" if said else "")
    gone = [f"about {lost} scans, {counts['lost_seconds']:.1f} s"] if lost else []
    gone += [f"{number} {reason.replace('_', ' ')}" for reason, number in counts["dropped"].items()]
    if not gone and used < scans:
        gone = [f"{scans - used} scans"]
    right = used >= least * scans and (bool(lost or told) or used + sum(counts["dropped"].values()) == scans)
    return Outcome(happened, ", ".join(gone) or "nothing", survived=right)


def _first(pattern: str, text: str) -> str:
    found = re.search(pattern, text)
    return found[0].strip() if found else ""


def _refused(folder: Path, damage: Callable[[Path], None]) -> Outcome:
    """Map what cannot be mapped: one line must say why."""
    bag = simulated(folder / "drive", *_MCAP)
    write_as_database(bag, folder / "robot_0.db3")
    damage(folder / "robot_0.db3")
    done, _ = mapped(folder / "robot_0.db3", folder / "maps")
    line = done.stderr.strip().splitlines()[-1] if done.stderr.strip() else ""
    return Outcome(
        f"refused in one line: {shortened(line.replace(f'{folder}/', ''))}", "everything", survived=done.is_one_line()
    )


def _without_metadata(storage: Path) -> None:
    """Remove the metadata beside a storage file."""
    (storage.parent / "metadata.yaml").unlink()


def _with_broken_metadata(storage: Path) -> None:
    """Spoil the metadata beside a storage file."""
    (storage.parent / "metadata.yaml").write_text("rosbag2_bagfile_information: [", encoding="utf-8")


def _case(
    name: str,
    kind: tuple[str, ...],
    damage: Callable[[Path], None],
    least: float,
    *,
    quick: bool = False,
    as_database: bool = False,
) -> FaultCase:
    attempt = partial(_tried, kind=kind, damage=damage, least=least, as_database=as_database)
    return FaultCase(name, attempt, quick)


_half = partial(cut, share=0.5)

CASES = (
    _case("ROS 1 bag cut in half", _ROS1, _half, 0.48, quick=True),
    _case("ROS 1 bag of 3 min cut in half, bz2", (*_BZ2, "--duration", "180"), _half, 0.44),
    _case("ROS 1 bag without its last byte", _ROS1, drop_last_byte, 1.0),
    _case("ROS 1 bag of a killed recorder, no index", _BZ2, forget_index, 1.0, quick=True),
    _case("ROS 1 bag whose index states wrong lengths", _ROS1, falsify_index, 1.0, quick=True),
    _case("ROS 1 bag, 50 kB of zeros in it", _ROS1, partial(zero, share=0.5, size=50_000), 0.9),
    _case("ROS 1 bag, a damaged bz2 chunk", _BZ2, partial(zero, share=0.5, size=500), 0.4),
    _case("ROS 1 bag, 300 bits flipped", _ROS1, partial(flip_bits, number=300), 0.9),
    _case("definition of another topic unreadable", _ROS1, spoil_definition, 1.0),
    _case("ROS 2 bag without metadata.yaml", _MCAP, _without_metadata, 1.0, quick=True),
    _case("ROS 2 bag, metadata.yaml spoilt", _MCAP, _with_broken_metadata, 1.0),
    _case("mcap cut in half", _MCAP, _half, 0.48),
    _case("mcap, 50 kB of zeros in it", _MCAP, partial(zero, share=0.5, size=50_000), 0.6),
    _case("sqlite database cut in half", _MCAP, _half, 0.48, quick=True, as_database=True),
    FaultCase("sqlite database that holds nothing", partial(_refused, damage=empty_database), quick=True),
    FaultCase("sqlite database overwritten by zeros", partial(_refused, damage=partial(zero, share=0.0, size=10**8))),
)
