import json

import pytest

from tools.benchmark import main
from tools.stranger_benchmark import KINDS, Encounter, _row, meet


def test_the_interval_is_that_of_clopper_and_pearson():
    none = [Encounter("unrelated", str(index), False, index < 3, 0.1) for index in range(100)]
    assert _row("unrelated", "", none)[2:] == ["100", "0", "0.00", "0.00 to 3.62", "3"]
    some = [*none[:-1], Encounter("unrelated", "x", True, False, 0.9)]
    assert _row("unrelated", "", some)[3:5] == ["1", "1.00"]
    assert _row("unrelated", "", [])[2:] == ["0", "0", "-", "-", "0"]


@pytest.mark.slow
def test_strangers_are_told_apart_by_any_number_of_workers(tmp_path, capsys):
    figures = [tmp_path / f"{workers}.json" for workers in (1, 2)]
    for workers, path in enumerate(figures, start=1):
        assert main(["strangers", "--pairs", "4", "--workers", str(workers), "--json", str(path)]) == 0
    assert capsys.readouterr().out.startswith("| pairs ")
    first, second = (json.loads(path.read_text())["encounters"] for path in figures)
    assert first == second
    assert {one["kind"] for one in first} == set(KINDS)


def test_the_same_numbers_make_the_same_pair():
    assert meet("unrelated", 5, 1) == meet("unrelated", 5, 1)
