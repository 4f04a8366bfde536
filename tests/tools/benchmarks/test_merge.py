import json

import pytest

from tools.benchmark import main
from tools.benchmarks.merge import MergeRun, _row


@pytest.mark.slow
def test_a_merge_is_timed_by_area(tmp_path, capsys):
    figures = tmp_path / "figures.json"
    assert main(["merge", "--areas", "900", "--repeat", "1", "--json", str(figures)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("| area m2 | cells")
    run = json.loads(figures.read_text())["runs"][0]
    assert run["area_m2"] == pytest.approx(900, rel=0.02)
    assert run["cells"] == pytest.approx(run["area_m2"] * 100, rel=1e-6)
    assert isinstance(run["is_right"], bool)  # so small a floor need not be distinctive
    assert min(run["features_ms"], run["fusion_ms"], run["cpu_ms"], run["align_cpu_s"]) > 0


def test_the_sum_is_that_of_the_papers_chain():
    assert MergeRun(1.0, 100, 1.0, 2.0, 3.0, 4.0, 99.0, 99.0, True, 99.0).sum_ms == 10.0


@pytest.mark.parametrize(
    ("area_m2", "program_ms", "faster"),
    [(4900.0, "212.0", "21.2"), (2450.0, "106.0", "10.6"), (25600.0, "1322.0", "132.2"), (41001.0, "-", "-")],
)
def test_the_program_is_compared_at_the_same_area(area_m2, program_ms, faster):
    row = _row(MergeRun(area_m2, 100, 1.0, 2.0, 3.0, 4.0, 20.0, 1.0, True, 99.0))
    assert (row["program ms"], row["times faster"]) == (program_ms, faster)
