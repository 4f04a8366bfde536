import itertools
import json

import numpy as np
import pytest

from merging.alignment import Alignment
from merging.merger import Merge
from tbmslam.geometry.se2 import SE2
from tools.benchmark import main
from tools.benchmarks import strangers
from tools.benchmarks.strangers import (
    KINDS,
    MAPS,
    SET_KINDS,
    Encounter,
    StrangerSet,
    _row,
    make_set,
    meet,
    meet_set,
    summary,
)


def test_the_interval_is_that_of_clopper_and_pearson():
    none = [Encounter("unrelated", index, str(index), False, index < 3, 0.1) for index in range(100)]
    assert _row("unrelated", "", none)[2:] == ["100", "0", "0.00", "0.00 to 3.62", "3"]
    some = [*none[:-1], Encounter("unrelated", 0, "x", True, False, 0.9)]
    assert _row("unrelated", "", some)[3:5] == ["1", "1.00"]
    assert _row("unrelated", "", [])[2:] == ["0", "0", "-", "-", "0"]


def test_a_run_continues_an_earlier_run(tmp_path, capsys, monkeypatch):
    tried = []

    def met(kind, number, seed):
        tried.append((kind, number, seed))
        return Encounter(kind, number, f"{kind}_{number}", number == 2, False, 0.9)

    monkeypatch.setattr(strangers, "meet", met)
    run = ["strangers", "--seed", "7", "--workers", "1", "--json", str(tmp_path / "so-far.json")]
    assert main([*run, "--pairs", "8"]) == 0
    assert main([*run, "--pairs", "12"]) == 0
    assert len(tried) == len(set(tried)) == 12
    printed = capsys.readouterr().out.split("| pairs ")[-1]
    assert "wrongly accepted: unrelated_2, confidence 0.900" in printed
    assert "| all " in printed


@pytest.mark.parametrize("content", ["{", "[]", '{"seed": 8, "judge": "", "encounters": []}', '{"encounters": [1]}'])
def test_another_run_is_not_gone_on_with(tmp_path, capsys, content):
    path = tmp_path / "other.json"
    path.write_text(content)
    assert main(["strangers", "--pairs", "4", "--seed", "7", "--json", str(path)]) == 1
    assert "other.json: is no earlier run with this seed and this code" in capsys.readouterr().err
    assert path.read_text() == content


def test_other_code_is_another_judge(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(strangers, "meet", lambda *numbers: Encounter(*numbers[:2], "x", False, False, 0.1))
    run = ["strangers", "--pairs", "4", "--workers", "1", "--json", str(tmp_path / "earlier.json")]
    assert main(run) == 0
    monkeypatch.setattr(strangers, "code_digest", lambda *_: "of another day")
    assert main(run) == 1
    assert "earlier.json: is no earlier run with this seed and this code" in capsys.readouterr().err


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_number_of_workers(tmp_path, capsys):
    figures = [tmp_path / f"{workers}.json" for workers in (1, 2)]
    for workers, path in enumerate(figures, start=1):
        assert main(["strangers", "--pairs", "4", "--workers", str(workers), "--json", str(path)]) == 0
    assert capsys.readouterr().out.startswith("| pairs ")
    first, second = (json.loads(path.read_text())["encounters"] for path in figures)
    assert first == second
    assert {one["kind"] for one in first} == set(KINDS)


def test_the_same_numbers_make_the_same_pair():
    assert meet("unrelated", 5, 1) == meet("unrelated", 5, 1)


def test_the_interval_of_sets_is_that_of_clopper_and_pearson():
    none = [StrangerSet("six buildings", index, (), (), 0, 0) for index in range(100)]
    rows = summary(none).rows
    assert rows[0][2:] == ["100", "0", "0", "0.00", "0.00 to 3.62", "-"]
    assert rows[1][2:] == ["0", "0", "0", "-", "-", "-"]
    pair = ("map_0", "map_1")
    wrong = StrangerSet("far ends", 0, (pair,), (pair,), 4, 6)
    assert summary([*none[1:], wrong]).rows[-1][2:6] == ["100", "1", "1", "1.00"]
    assert summary([wrong]).rows[3][-1] == "4 of 6"


def test_wrong_joins_are_listed_with_the_reason(monkeypatch, capsys):
    met = {
        0: StrangerSet("six buildings", 0, (), (("map_1", "map_4"),), 0, 0),
        1: StrangerSet("mirrored", 1, (("map_0", "map_2"),), (("map_0", "map_2"), ("map_2", "map_3")), 0, 0),
    }
    monkeypatch.setattr(strangers, "meet_set", lambda number, _: met[number])
    assert main(["strangers", "--sets", "2", "--workers", "1"]) == 0
    printed = capsys.readouterr().out
    assert "wrongly joined: map_1, map_4 of set 0, six buildings, by refused pairs that agree" in printed
    assert "wrongly joined: map_0, map_2, map_3 of set 1, mirrored, by an accepted pair" in printed


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--sets", "-1"), "--sets: must be a whole number of at least 0"),
        (("--sets", "2", "--json", "x.json"), "--json keeps pairs"),
    ],
)
def test_what_cannot_be_meant_is_wrong_usage(usage_error, options, why):
    assert why in usage_error(main, ["strangers", *options])


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

    monkeypatch.setattr(strangers, "merge", all_joined)
    met = meet_set(number, 3)
    same = [placed[a].place == placed[b].place for a, b in itertools.combinations(placed, 2)]
    assert (met.right, met.possible) == (sum(same), sum(same))
    assert len(met.joined) == len(met.accepted) == same.count(False)
    assert met.possible == (0 if met.kind == "six buildings" else 6)
    monkeypatch.setattr(strangers, "make_set", lambda *_: placed | {"map_0": _elsewhere(placed["map_0"])})
    assert meet_set(number, 3).right == 6 - 2 if met.possible else True


def _elsewhere(one):
    return type(one)(one.place, one.occupancy, one.resolution, SE2(3.0, 0.0, 0.0) @ one.T_map_building)
