import json

from tests.tools.calibration.test_deformed_fit import trials
from tools import calibrate_deformed
from tools.calibrate_deformed import pairs_of_building


def test_the_model_is_fitted_and_written(monkeypatch, tmp_path, capsys):
    some, seen = trials(), []
    monkeypatch.setattr(calibrate_deformed, "trials_of_building", lambda number: some if number == 0 else [])
    monkeypatch.setattr(calibrate_deformed, "trials_of_strangers", lambda *arguments: seen.append(arguments) or [])
    out = tmp_path / "model.json"
    words = ["--buildings", "3", "--strangers", "2", "--workers", "1", "-o", str(out)]
    assert calibrate_deformed.main(words) == 0
    assert seen == [(0, 120.0), (1, 120.0)]  # twenty pairs of two places for each of twelve pairs of one
    assert set(json.loads(out.read_text())) == {"bias", "less_certain_test", "agreeing_share"}
    printed = capsys.readouterr().out
    assert "passed both tests" in printed
    assert "100" in printed


def test_pairs_that_are_never_deformed_are_an_error(monkeypatch, capsys):
    for name in ("trials_of_building", "trials_of_strangers"):
        monkeypatch.setattr(calibrate_deformed, name, lambda *_: [])
    assert calibrate_deformed.main(["--buildings", "1", "--strangers", "1", "--workers", "1"]) == 1
    assert "no map was deformed: try more pairs" in capsys.readouterr().err


def test_buildings_are_bent_in_turn():
    usual, bent = ([round(100 * pair.overlap) for pair in pairs_of_building(number)] for number in (0, 1))
    assert usual == [50, 35, 25, 15]
    assert bent == [100, 50, 35, 25]
