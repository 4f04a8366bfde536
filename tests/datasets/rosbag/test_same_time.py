"""Bags of two robots that are taken for one recording."""

import shutil

import pytest

from datasets import DatasetError, open_recording
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
