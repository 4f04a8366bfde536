import json

import pytest

from tools.benchmark import main
from tools.benchmarks import strangers
from tools.benchmarks.strangers import KINDS, Encounter, _row, meet


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


def test_the_judge_knows_the_simulator_and_the_benchmark(monkeypatch):
    known = []
    monkeypatch.setattr(strangers, "code_digest", lambda *packages: known.extend(packages) or "")
    strangers._judge()
    assert known == ["tbmslam", "datasets", "merging", "tools.benchmarks"]


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
