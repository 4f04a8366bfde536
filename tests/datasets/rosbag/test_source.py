"""Damaged bags of every kind: everything readable is used, and what was lost is said."""

import json
import os
import re
import shutil
import sqlite3

import numpy as np
import pytest
import yaml
from rosbags import rosbag1

from datasets import DatasetError, open_recording
from datasets.rosbag.source import BagSource
from datasets.salvage.salvaged_bag import BagAnnouncement, announced_by

# One worker writes the bags for all of them.
pytestmark = pytest.mark.xdist_group("damaged bags")

SCANS = 300
COMPRESSIONS = ("none", "bz2", "lz4")
rng = np.random.default_rng(1)
NOISE = rng.uniform(1.0, 20.0, (SCANS, 4000))


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    return tmp_path_factory.mktemp("originals")


@pytest.fixture
def bag(script, originals, tmp_path):
    """Return a function that gives a copy of a 30 s drive, whose scans do not compress away."""

    def copy_of(kind):
        name = "run.bag" if kind in COMPRESSIONS else "run"
        original = originals / kind / name
        if not original.exists():
            original.parent.mkdir()
            script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 131.0)
            for k in range(SCANS):
                script.scan(100.5 + 0.1 * k, NOISE[k, :: smaller(kind)], step=0.001)
            script.in_time_order().write(original, kind, (1 << 20) // smaller(kind))
        path = tmp_path / name
        if original.is_file():
            return shutil.copyfile(original, path)
        shutil.copytree(original, path)
        return next(file for file in path.iterdir() if file.suffix != ".yaml")

    return copy_of


def smaller(kind):
    """Return how much smaller scans and chunks are: bz2 is slow."""
    return 4 if kind == "bz2" else 1


def cut(path, share):
    os.truncate(path, int(path.stat().st_size * share))


def overwrite(path, share, content):
    with path.open("r+b") as file:
        file.seek(int(path.stat().st_size * share))
        file.write(content)


def used(path):
    recording = open_recording([path])
    readings = list(recording)
    assert [reading.scan.stamp for reading in readings] == sorted(reading.scan.stamp for reading in readings)
    json.dumps(recording.counts.as_dict())
    return len(readings), recording.counts


def test_the_bag_of_2010_gives_all_its_scans(shared_data, caplog):
    number, counts = used(shared_data / "broken" / "wrong-index-length.bag")
    assert (number, counts.lost_scans) == (360, 0)
    assert "the index of the bag contradicts itself; 360 scans were read, no scan seems to be lost" in (caplog.text)


def test_the_loss_of_a_truncated_recording_is_stated(shared_data, caplog):
    number, counts = used(shared_data / "broken" / "truncated-intel.bag")
    assert number == 2436
    assert number + counts.lost_scans == pytest.approx(13631, rel=0.06)  # what the whole bag holds
    assert re.search(
        r"cut off or its index is damaged; 2436 scans were read, about \d+ scans, 1\d\d\d\.\d s, lost", caplog.text
    )


@pytest.mark.parametrize("kind", [*COMPRESSIONS, "mcap"])
def test_one_missing_byte_loses_nothing(bag, kind):
    path = bag(kind)
    os.truncate(path, path.stat().st_size - 1)
    number, counts = used(path)
    assert (number, counts.lost_scans) == (SCANS, 0)


@pytest.mark.parametrize("kind", [*COMPRESSIONS, "sqlite3", "mcap"])
def test_half_a_bag_gives_its_half(bag, kind, caplog):
    path = bag(kind)
    cut(path, 0.5)
    number, counts = used(path)
    # A compressed chunk ends where it is cut: the half may be a chunk of 64 scans short.
    assert number == pytest.approx(SCANS / 2, abs=5 if kind in ("none", "sqlite3", "mcap") else 64)
    assert number > 0
    if kind == "mcap":
        assert "it is cut off, and the number of missing messages is unknown; 1" in caplog.text
        assert "scans were read, some are lost" in caplog.text
    else:
        assert number + counts.lost_scans == pytest.approx(SCANS, abs=25)
        assert counts.lost_seconds == pytest.approx(0.1 * counts.lost_scans, abs=0.2)


@pytest.mark.parametrize("kind", COMPRESSIONS)
def test_an_unindexed_bag_loses_nothing(bag, kind, caplog):
    path = bag(kind)
    content = path.read_bytes()
    place = content.index(b"index_pos=") + len("index_pos=")
    path.write_bytes(content[:place] + bytes(8) + content[place + 8 :])
    number, counts = used(path)
    assert (number, counts.lost_scans) == (SCANS, 0)
    assert "the bag has no index, its recorder was interrupted; 300 scans were read" in caplog.text


def test_a_hole_in_the_middle_of_a_sound_index(bag):
    path = bag("none")
    overwrite(path, 0.5, bytes(80_000))
    number, counts = used(path)
    assert SCANS - 8 <= number < SCANS
    assert number + counts.lost_scans == pytest.approx(SCANS, abs=1)
    (incident, *_) = [each for each in counts.incidents if "lost" in each.what]
    assert incident.stamp == pytest.approx(115.0, abs=1.5)


@pytest.mark.parametrize("kind", ["bz2", "lz4"])
def test_one_damaged_chunk_costs_no_other(bag, kind):
    path = bag(kind)
    overwrite(path, 0.55, bytes(2000))
    number, counts = used(path)
    assert SCANS // 3 < number <= SCANS  # lz4 stores what it cannot compress, and there zeros are not noticed
    assert number + counts.lost_scans == pytest.approx(SCANS, abs=3)


def test_an_mcap_with_a_hole(bag):
    path = bag("mcap")
    overwrite(path, 0.5, bytes(40_000))
    number, counts = used(path)
    assert 0 < number < SCANS
    assert counts.lost_scans >= 0


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_a_directory_with_missing_or_damaged_metadata(bag, kind, caplog):
    folder = bag(kind).parent
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    assert used(folder)[0] == SCANS
    (folder / "metadata.yaml").unlink()
    assert used(folder)[0] == SCANS
    assert "no metadata.yaml in this directory; 300 scans were read" in caplog.text


def test_parts_of_a_directory_are_read_in_their_order(bag, script, tmp_path):
    folder = bag("mcap").parent
    (folder / "metadata.yaml").unlink()
    storage = next(folder.glob("*.mcap"))
    storage.rename(folder / "run_9.mcap")
    later = type(script)().drive(131.0, 134.0)
    for k in range(20):
        later.scan(131.5 + 0.1 * k, NOISE[k], step=0.001)
    more = later.in_time_order().write(tmp_path / "more", "mcap")
    next(more.glob("*.mcap")).rename(folder / "run_10.mcap")
    (folder / "run_11.mcap").write_bytes(b"")
    assert used(folder)[0] == SCANS + 20


def test_the_damage_of_a_directory_of_one_file_is_told_once(bag, caplog):
    folder = bag("mcap").parent
    cut(next(folder.glob("*.mcap")), 0.5)
    assert used(folder)[0] > 0
    assert sum("the bag is damaged" in line for line in caplog.messages) == 1


def test_a_directory_without_storage(bag):
    folder = bag("mcap").parent
    next(folder.glob("*.mcap")).rename(folder / "run.mcap.zstd")
    with pytest.raises(
        DatasetError, match=r"run: its storage \S+ is missing, and the folder holds no storage file .*decompress"
    ):
        open_recording([folder])
    (folder / "metadata.yaml").unlink()
    with pytest.raises(
        DatasetError, match=r"run: no metadata\.yaml in this directory, and the folder holds no storage file"
    ):
        open_recording([folder])


def test_a_database_that_opens_and_holds_nothing(bag, caplog):
    path = bag("sqlite3")
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM messages")
    database.close()
    with pytest.raises(DatasetError, match=r"run.db3: /scan holds no messages: give another recording"):
        open_recording([path])
    with pytest.raises(DatasetError, match=r"run: no scan of /scan can be decoded"):
        open_recording([path.parent])
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE messages")
        database.execute("DROP TABLE topics")
        database.execute("VACUUM")
    database.close()
    with pytest.raises(DatasetError, match=r"run.db3: the bag is damaged .*no message in it can be read: fetch it"):
        open_recording([path])


def test_a_directory_that_announces_more_than_there_is(bag, caplog):
    path = bag("sqlite3")
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM messages WHERE timestamp > 120000000000")
    database.close()
    assert used(path.parent)[0] < 200
    assert re.search(r"run: 10\d of 300 scans that it announces are missing", caplog.text)


@pytest.mark.parametrize("kind", ["none", "mcap", "sqlite3"])
def test_nothing_readable_is_an_error(bag, kind):
    path = bag(kind)
    cut(path, 600 / path.stat().st_size)
    with pytest.raises(DatasetError, match=r"(no message in it|no part of it) can be read.*fetch it again") as caught:
        BagSource(path)
    assert "\n" not in str(caught.value)


def test_a_file_that_vanishes(bag):
    path = bag("none")
    source = BagSource(path)
    source.close()
    path.unlink()
    with pytest.raises(DatasetError, match=r"run\.bag: cannot be read: No such file"):
        list(source.messages(["/scan"], "/scan"))
    with pytest.raises(DatasetError, match=r"run\.bag: cannot be read: No such file"):
        BagSource(path)


@pytest.mark.parametrize("kind", COMPRESSIONS)
def test_salvage_gives_the_messages_of_the_sound_bag(bag, kind):
    path = bag(kind)
    topics = ("/scan", "/tf", "/tf_static")
    sound = [(m.connection.topic, m.time, m.data) for m in BagSource(path).messages(topics, "/scan")]
    os.truncate(path, path.stat().st_size - 1)
    source = BagSource(path)
    assert source.damage is not None
    assert [(m.connection.topic, m.time, m.data) for m in source.messages(topics, "/scan")] == sound


@pytest.mark.parametrize("kind", [*COMPRESSIONS, "sqlite3", "mcap"])
def test_passes_at_a_time_do_not_disturb_each_other(bag, kind):
    source = BagSource(bag(kind))
    alone = [(m.connection.topic, m.time, m.data) for m in source.messages(["/scan", "/tf"], "/scan")]
    both = zip(source.messages(["/scan", "/tf"], "/scan"), source.messages(["/scan", "/tf"], "/scan"), strict=True)
    assert [(m.connection.topic, m.time, m.data) for pair in both for m in pair] == [m for m in alone for _ in range(2)]
    source.close()
    assert [(m.connection.topic, m.time, m.data) for m in source.messages(["/scan", "/tf"], "/scan")] == alone


def test_a_pass_that_is_broken_off_leaves_no_trace(bag):
    source = BagSource(bag("lz4"))
    first = next(iter(source.messages(["/scan"], "/scan")))
    assert next(iter(source.messages(["/scan"], "/scan"))) == first


def test_a_bag_is_opened_once_from_its_plan_to_the_end_of_its_pass(bag, monkeypatch):
    opened = []
    plainly = rosbag1.Reader.open
    monkeypatch.setattr(rosbag1.Reader, "open", lambda reader: opened.append(reader) or plainly(reader))
    recording = open_recording([bag("none")])
    readings = sum(1 for _ in recording)
    assert (readings, len(opened)) == (SCANS, 1)
    assert opened[0].bio is None
    assert sum(1 for _ in recording) == readings


def test_a_database_cut_near_its_end(bag, caplog):
    """Sqlite itself reads zeros there, so that a scan of zeros came out and nothing was said."""
    path = bag("sqlite3")
    os.truncate(path, path.stat().st_size - 50_000)
    for each in (path, path.parent):
        caplog.clear()
        number, counts = used(each)
        assert SCANS - 8 <= number < SCANS
        assert counts.lost_scans == pytest.approx(SCANS - number, abs=1)
        assert counts.beams["hit"] == 4000 * number
        assert caplog.text.count("the database is cut off, ") == 1


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
@pytest.mark.parametrize("gone", ["removed", "empty"])
def test_a_missing_part_of_a_directory_is_counted(bag, script, tmp_path, caplog, kind, gone):
    folder = bag(kind).parent
    storage = next(file for file in folder.iterdir() if file.suffix != ".yaml")
    other = folder / f"run_1{storage.suffix}"
    other.write_bytes(b"")
    metadata = folder / "metadata.yaml"
    said = yaml.safe_load(metadata.read_text())
    bag_info = said["rosbag2_bagfile_information"]
    bag_info["relative_file_paths"].append(other.name)
    for topic in bag_info["topics_with_message_count"]:
        topic["message_count"] *= 2
    metadata.write_text(yaml.safe_dump(said))
    if gone == "removed":
        other.unlink()
    number, counts = used(folder)
    assert (number, counts.lost_scans) == (SCANS, SCANS)
    assert counts.lost_seconds == pytest.approx(15.5, abs=1.0)  # half of what the description says it lasts
    assert f"{SCANS} scans were read, about {SCANS} scans" in caplog.text
    assert ("its storage run_1" in caplog.text) is (gone == "removed")


def test_a_description_that_makes_no_sense_announces_nothing(tmp_path):
    for text in ("", "[1]", "a: &a [*a]", "rosbag2_bagfile_information: {relative_file_paths: 3}"):
        (tmp_path / "metadata.yaml").write_text(text)
        assert announced_by(tmp_path) == BagAnnouncement()


def test_a_bag_with_one_truncated_compressed_chunk(script, tmp_path, caplog):
    script.tf(100.0, "base_link", "laser", topic="/tf_static").drive(100.0, 112.0)
    for k in range(100):
        script.scan(100.5 + 0.1 * k, NOISE[k, :180], step=0.01)
    path = script.in_time_order().write(tmp_path / "run.bag", "lz4")
    cut(path, 0.8)
    number, counts = used(path)
    assert 0 < number < 100
    assert number + counts.lost_scans == pytest.approx(100, abs=10)
    assert "no scan is lost" not in caplog.text
