import sys
from pathlib import Path

import pytest

from merging.config import MergeConfig
from tbmslam.parallel.executor import Executor
from tests.tools.calibration.test_model_fit import trials
from tools import calibrate_merging
from tools.calibrate_merging import FittedPair


def test_a_folder_in_several_lists_counts_in_each(monkeypatch, capsys):
    monkeypatch.setattr(calibrate_merging, "pairs_of", lambda *_, **__: [])
    monkeypatch.setattr(calibrate_merging, "trials_of", lambda groups, *_: [(name, trials(12)) for name, _ in groups])
    assert calibrate_merging.main(["a", "--simulated", "a", "--bent", "a", "--workers", "1"]) == 0
    tables = capsys.readouterr().out.split("\n\n")
    assert [table.splitlines()[0] for table in tables] == [
        "a, by models fitted without its buildings",
        "a, by models fitted without its buildings",
        "a, bent, by models fitted without its buildings",
        "all pairs, by models fitted without their buildings",
    ]
    counted = [int(line.split("|")[2]) for line in tables[-1].splitlines()[3:]]
    assert sum(counted) == 3 * 12


def test_each_group_has_the_trials_of_its_pairs(monkeypatch):
    monkeypatch.setattr(calibrate_merging, "_trial_of", lambda pair, _: None if pair.path.name == "empty" else pair)
    full, other, empty = (FittedPair(Path(name), 1.0, bent=False) for name in ("full", "other", "empty"))
    groups = [("one", [full, empty]), ("none", [empty]), ("two", [empty, other, full])]
    found = calibrate_merging.trials_of(groups, MergeConfig(), Executor())
    assert found == [("one", [full]), ("none", []), ("two", [other, full])]


def test_a_plot_without_matplotlib_is_one_line_before_anything_runs(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert calibrate_merging.main([str(tmp_path / "none"), "--plot", "calibration.png"]) == 1
    wanted = "calibrate_merging: --plot needs matplotlib: pip install 'tbmslam[paper]'\n"
    assert capsys.readouterr().err == wanted


@pytest.mark.parametrize("count", ["-5", "1.5"])
def test_a_number_of_strangers_is_not_negative(usage_error, count):
    assert f"--strangers: must be a whole number of at least 0, got '{count}'" in usage_error(
        calibrate_merging.main, ["a", "--strangers", count]
    )
