import json

import pytest

from tools.benchmark import main


@pytest.mark.slow
def test_scaling(tmp_path, capsys):
    path = tmp_path / "figures.json"
    assert main(["scaling", "--lengths", "20,40", "--preset", "viny", "--json", str(path)]) == 0
    record = json.loads(path.read_text())
    runs = {(run["route"], run["length_m"]): run for run in record["runs"]}
    assert list(runs) == [("round", 20.0), ("round", 40.0), ("spiral", 20.0), ("spiral", 40.0)]
    assert runs["spiral", 40.0]["seen_m2"] > 1.3 * runs["spiral", 20.0]["seen_m2"]
    assert runs["spiral", 40.0]["scans"] == pytest.approx(2 * runs["spiral", 20.0]["scans"], rel=0.2)
    assert all(0.0 < run["matching_us"] < run["scan_us"] for run in record["runs"])
    assert record["failures"] == []
    assert capsys.readouterr().out.startswith("| route ")
