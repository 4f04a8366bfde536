import numpy as np
import pytest

from tools.benchmark import main
from tools.benchmarks import stranger_sets
from tools.benchmarks.stranger_sets import MAPS, StrangerSet, make_set, summary


def test_the_interval_is_that_of_clopper_and_pearson():
    none = [StrangerSet(index, (), ()) for index in range(100)]
    rows = [line.split("|")[1:-1] for line in summary(none).splitlines()]
    assert [cell.strip() for cell in rows[2]] == ["100", "6", "1500", "0", "0", "0.00", "0.00 to 3.62"]
    wrong = StrangerSet(0, (("map_0", "map_1"),), (("map_0", "map_1"),))
    assert [cell.strip() for cell in summary([*none[1:], wrong]).splitlines()[2].split("|")[4:7]] == ["1", "1", "1.00"]


def test_what_was_joined_is_told_with_the_reason(monkeypatch, capsys):
    met = {
        0: StrangerSet(0, (), (("map_1", "map_4"),)),
        1: StrangerSet(1, (("map_0", "map_2"),), (("map_0", "map_2"),)),
    }
    monkeypatch.setattr(stranger_sets, "meet_set", lambda number, _: met[number])
    assert main(["strangers", "--sets", "2", "--workers", "1"]) == 0
    printed = capsys.readouterr().out
    assert "wrongly joined: map_1, map_4 of set 0, by refused pairs that lead to each other" in printed
    assert "wrongly joined: map_0, map_2 of set 1, by an accepted pair" in printed


@pytest.mark.parametrize(
    ("options", "why"),
    [(("--sets", "-1"), "--seed and --sets not negative"), (("--sets", "2", "--json", "x.json"), "--json keeps pairs")],
)
def test_what_cannot_be_meant_is_wrong_usage(capsys, options, why):
    with pytest.raises(SystemExit) as stopped:
        main(["strangers", *options])
    assert stopped.value.code == 2
    assert why in capsys.readouterr().err


@pytest.mark.slow
def test_the_same_numbers_make_the_same_set_and_others_another():
    maps, again, other = make_set(0, 3), make_set(0, 3), make_set(1, 3)
    assert len(maps) == MAPS
    for name, one in maps.items():
        np.testing.assert_array_equal(one.grid.masses, again[name].grid.masses)
    assert any(one.grid.masses.shape != other[name].grid.masses.shape for name, one in maps.items())
