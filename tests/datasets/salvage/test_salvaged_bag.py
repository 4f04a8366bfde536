from pathlib import Path

import numpy as np
import pytest

from datasets.salvage.salvaged_bag import BagConnection, Hole, SalvagedBag


def bag_of(times, holes=()):
    entries = np.array([(round(time * 1e9), 1, 0, 10 * k, 10) for k, time in enumerate(times)], dtype=np.int64)
    connections = [BagConnection(1, "/scan", "x", "", len(times)), BagConnection(2, "/empty", "x", "", 0)]
    content = bytes(range(256)) * 40
    return SalvagedBag(Path("run.bag"), "cut", connections, entries.reshape(-1, 5), holes, lambda _: content)


def test_messages_by_time_and_as_written():
    bag = bag_of([1.0, 3.0, 2.0])
    by_time = [(time, data[0]) for _, time, data in bag.messages(bag.connections, by_time=True)]
    assert by_time == [(10**9, 0), (2 * 10**9, 20), (3 * 10**9, 10)]
    assert [time for _, time, _ in bag.messages(bag.connections, by_time=False)] == [10**9, 3 * 10**9, 2 * 10**9]
    assert list(bag.messages([bag.connections[1]], by_time=True)) == []


def test_a_hole_in_the_middle_is_as_long_as_its_pause():
    times = [*np.arange(0.0, 10.0, 0.1), *np.arange(15.0, 20.0, 0.1)]
    (loss,) = bag_of(times, (Hole(100, 3), Hole(100, 9))).losses("/scan")
    assert (loss.since, loss.seconds, loss.messages) == (pytest.approx(9.9), pytest.approx(5.0), 50)
    assert bag_of(times, (Hole(50, 3),)).losses("/scan") == []


def test_a_hole_at_an_end_is_as_long_as_its_bytes():
    times = np.arange(0.0, 10.0, 0.1)
    (loss,) = bag_of(times, (Hole(100, 500),)).losses("/scan")
    assert (loss.since, loss.seconds, loss.messages) == (pytest.approx(9.9), pytest.approx(5.0), 50)
    assert bag_of(times, (Hole(0, 100),)).losses("/scan")[0].messages == 10
    assert bag_of([], (Hole(0, 100),)).losses("/scan") == []
    assert bag_of(times, (Hole(100, 500),)).losses("/empty") == []


def test_a_single_message_gives_no_estimate_of_the_loss():
    (loss,) = bag_of([3.0], (Hole(1, 500),)).losses("/scan")
    assert (loss.since, loss.seconds, loss.messages) == (3.0, 0.0, 0)
    assert bag_of([3.0]).losses("/scan") == []
