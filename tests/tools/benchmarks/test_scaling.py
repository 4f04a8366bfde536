import json

import pytest

from tools.benchmark import main
from tools.benchmarks.scaling import LIMITS, last_quarter_us


def test_the_last_quarter_is_the_last_quarter_of_the_blocks():
    stops = [(0, 0.0), (50, 1.0), (100, 2.0), (150, 3.0), (200, 3.0001)]
    assert last_quarter_us(stops) == pytest.approx(2.0)
    assert last_quarter_us(stops[:2]) == pytest.approx(20_000.0)


@pytest.mark.slow
def test_scaling(tmp_path, capsys):
    path = tmp_path / "figures.json"
    assert main(["scaling", "--lengths", "20,40", "--preset", "viny", "--json", str(path)]) == 0
    record = json.loads(path.read_text())
    runs = {(run["route"], run["length_m"]): run for run in record["runs"]}
    assert list(runs) == [("round", 20.0), ("round", 40.0), ("spiral", 20.0), ("spiral", 40.0)]
    assert runs["spiral", 40.0]["seen_m2"] > 1.3 * runs["spiral", 20.0]["seen_m2"]
    assert runs["spiral", 40.0]["scans"] == pytest.approx(2 * runs["spiral", 20.0]["scans"], rel=0.2)
    assert all(run["scan_us"] > 0.0 for run in record["runs"])
    assert record["failures"] == []
    assert capsys.readouterr().out.startswith("| route ")


def broken(preset_name, route, *_):
    raise KeyError(route)


@pytest.mark.slow
def test_a_drive_that_fails_is_a_row_and_the_others_go_on(monkeypatch, capsys):
    monkeypatch.setattr("tools.benchmarks.scaling.run_scaling", broken)
    assert main(["scaling", "--lengths", "20", "--preset", "viny"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "round viny 20 m: KeyError: 'round'" in lines
    assert "spiral viny 20 m: KeyError: 'spiral'" in lines
    assert main(["limits", "--share", "0.005"]) == 0
    rows = capsys.readouterr().out.splitlines()[2 : 2 + len(LIMITS)]
    assert [row.split("|")[-2].strip() for row in rows] == ["no: KeyError: 'round'", "no: KeyError: 'spiral'"]


@pytest.mark.slow
def test_a_little_of_every_limit_is_driven(tmp_path, capsys):
    figures = tmp_path / "figures.json"
    assert main(["limits", "--share", "0.005", "--json", str(figures)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("| what")
    assert [line.rstrip(" |").endswith("yes") for line in lines[2 : 2 + len(LIMITS)]] == [True] * len(LIMITS)
    runs = json.loads(figures.read_text())["runs"]
    assert [run["length_m"] for run in runs] == pytest.approx([0.005 * limit.length for limit in LIMITS])


@pytest.mark.parametrize("share", ["0", "1.5", "nan"])
def test_a_share_that_means_nothing_is_wrong_usage(share, usage_error):
    assert "--share: must be a number within 0.0001 and 1" in usage_error(main, ["limits", "--share", share])
