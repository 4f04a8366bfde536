import itertools
import json

import numpy as np
import pytest

from merging.alignment import Alignment
from merging.merger import Merge
from tbmslam.geometry.se2 import SE2
from tools.benchmark import main
from tools.benchmarks import stranger_sets
from tools.benchmarks.stranger_sets import MAPS, SET_KINDS, StrangerSet, make_set, meet_set, summary


def test_the_interval_of_sets_is_that_of_clopper_and_pearson():
    none = [StrangerSet("six buildings", index, (), (), 0, 0) for index in range(100)]
    rows = summary(none).rows
    assert rows[0][2:] == ["100", "0", "0", "0.00", "0.00 to 3.62", "-"]
    assert rows[1][2:] == ["0", "0", "0", "-", "-", "-"]
    pair = ("map_0", "map_1")
    wrong = StrangerSet("far ends", 0, (pair,), (pair,), 4, 6)
    assert summary([*none[1:], wrong]).rows[-1][2:6] == ["100", "1", "1", "1.00"]
    assert summary([wrong]).rows[3][-1] == "4 of 6"


def test_wrong_joins_are_listed_with_the_reason(monkeypatch, tmp_path, capsys):
    met = {
        0: StrangerSet("six buildings", 0, (), (("map_1", "map_4"),), 0, 0),
        1: StrangerSet("mirrored", 1, (("map_0", "map_2"),), (("map_0", "map_2"), ("map_2", "map_3")), 0, 0),
    }
    monkeypatch.setattr(stranger_sets, "meet_set", lambda number, _: met[number])
    assert main(["strangers", "--sets", "2", "--workers", "1", "--json", str(tmp_path / "sets.json")]) == 0
    printed = capsys.readouterr().out
    assert "wrongly joined: map_1, map_4 of set 0, six buildings, by refused pairs that agree" in printed
    assert "wrongly joined: map_0, map_2, map_3 of set 1, mirrored, by an accepted pair" in printed
    figures = json.loads((tmp_path / "sets.json").read_text())
    assert [outcome["number"] for outcome in figures["sets"]] == [0, 1]


def test_a_negative_number_of_sets_is_wrong_usage(usage_error):
    assert "--sets: must be a whole number of at least 0" in usage_error(main, ["strangers", "--sets", "-1"])


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(SET_KINDS)))
def test_joins_are_held_against_where_the_maps_are(monkeypatch, number):
    placed, again, other = make_set(number, 3), make_set(number, 3), make_set(number + len(SET_KINDS), 3)
    assert len(placed) == MAPS
    for name, one in placed.items():
        np.testing.assert_array_equal(one.occupancy, again[name].occupancy)
    assert any(one.occupancy.shape != other[name].occupancy.shape for name, one in placed.items())

    def all_joined(maps, _):
        found = {}
        for a, b in itertools.combinations(maps, 2):
            motion = placed[a].T_map_building @ placed[b].T_map_building.inverse()
            found[a, b] = Alignment("correlation", True, "", motion, agreed_wall_m=10.0, confidence=0.95)
        return Merge(None, {}, found, {}, None)

    monkeypatch.setattr(stranger_sets, "merge", all_joined)
    met = meet_set(number, 3)
    same = [placed[a].place == placed[b].place for a, b in itertools.combinations(placed, 2)]
    assert (met.right, met.possible) == (sum(same), sum(same))
    assert len(met.joined) == len(met.accepted) == same.count(False)
    assert met.possible == (0 if met.kind == "six buildings" else 6)
    monkeypatch.setattr(stranger_sets, "make_set", lambda *_: placed | {"map_0": _elsewhere(placed["map_0"])})
    assert meet_set(number, 3).right == 6 - 2 if met.possible else True


def _elsewhere(one):
    return type(one)(one.place, one.occupancy, one.resolution, SE2(3.0, 0.0, 0.0) @ one.T_map_building)
