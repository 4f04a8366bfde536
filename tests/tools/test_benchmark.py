import json
import subprocess
import sys
from pathlib import Path

import pytest

from tools.benchmark import main
from tools.slam_benchmark import Result, against_targets, median_run, over_seeds
from tools.slam_run import SlamRun

ROOT = Path(__file__).resolve().parents[2]


def figures(mapping_s=1.0, beams=1040, ate_m=None):
    return SlamRun(
        scans=1000,
        beams=beams,
        keyframes=10,
        duration_s=50.0,
        length_m=20.0,
        start_s=2.0,
        reading_s=0.1,
        mapping_s=mapping_s,
        matching_s=0.5,
        inserting_s=0.3,
        finishing_s=0.1,
        closing_s=0.05,
        wall_s=1.2,
        start_memory_mb=200.0,
        peak_memory_mb=300.0,
        ate_m=ate_m,
    )


def test_a_simulated_drive(tmp_path, capfd):
    path = tmp_path / "figures.json"
    world = "office:1:good,beams=181,duration=6"
    assert main(["slam", "--world", world, "--seeds", "2", "--json", str(path)]) == 0
    out, err = capfd.readouterr()
    table = [line for line in out.splitlines() if line.startswith("|")]
    assert len({len(line) for line in table}) == 1
    assert [line.split("|")[2].strip() for line in table[2:]] == ["default"] * 2
    assert "office:*:good,beams=181,duration=6 default: 2 seeds, 0 lost" in out
    assert "Warm-up:" in out
    assert f"benchmark: {world} default" in err
    record = json.loads(path.read_text())
    assert record["machine"]["numba"]
    for result in record["results"]:
        run = result["median"]
        assert (run["scans"], run["beams"]) == (120, 181)
        assert run["ate_m"] < 0.1
        assert run["translation_error_m"] is None
        assert 0.0 < run["matching_s"] + run["inserting_s"] < run["mapping_s"]
        assert run["closing_s"] <= run["finishing_s"] < run["mapping_s"]
        assert 50.0 < run["start_memory_mb"] <= run["peak_memory_mb"] < 2000.0


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


def test_the_median_of_each_figure_counts():
    median = median_run([figures(1.0, ate_m=0.5), figures(9.0, ate_m=0.5), figures(2.0, ate_m=0.5)])
    assert median.mapping_s == pytest.approx(2.0)
    assert median.ate_m == pytest.approx(0.5)
    assert median.translation_error_m is None


def test_targets_count_at_their_number_of_beams_only():
    runs = (figures(0.5),)
    lines = against_targets(
        [
            Result("office", "viny", figures(0.5), runs),
            Result("office", "viny-hc", figures(2.0), runs),
            Result("intel", "viny", figures(0.5, beams=180), runs),
            Result("office", "default", figures(0.5), runs),
        ]
    )
    assert lines == [
        "office viny: 2000 scans per CPU second, to be at least 1150 at 1040 beams: met",
        "office viny-hc: 500 scans per CPU second, to be at least 775 at 1040 beams: MISSED",
    ]


def test_the_worst_of_several_seeds_is_named():
    results = [
        Result(f"office:{seed}:poor", "default", figures(ate_m=error), (), "office:*:poor")
        for seed, error in ((1, 0.01), (2, 0.75), (3, 0.02))
    ]
    alone = Result("halls:1:good", "default", figures(ate_m=0.1), (), "halls:*:good")
    assert over_seeds([*results, alone, Result("intel", "default", figures(), ())]) == [
        "office:*:poor default: 3 seeds, 1 lost (ATE above 0.5 m), median ATE 0.0200 m, worst 0.7500 m in office:2:poor"
    ]


def test_a_recording_that_is_missing_is_one_line_and_exit_1(tmp_path, capsys):
    assert main(["slam", str(tmp_path / "none.bag")]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1].startswith("benchmark: ")
    assert "none.bag: no such file or directory" in lines[-1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["slam"], "slam needs recordings or --world"),
        (["slam", "a.bag", "--preset", "best"], "--preset: there is no 'best'; there are default, viny"),
        (["slam", "a.bag,angel=1"], "unrecognized arguments: --angel 1"),
        (["slam", "a.bag", "--repeat", "0"], "--repeat must be at least 1, got 0"),
        (["slam", "--world", "office:1:good", "--seeds", "0"], "--seeds must be at least 1, got 0"),
        (["slam", "--world", "office"], "--world must look like office:1:good, got 'office'"),
        (["slam", "--world", "castle:1:good"], "invalid choice: 'castle'"),
        (["merge", "--areas", "0"], "--areas must lie within 1 and 1e7 m2"),
        (["merge", "--areas", "4900,nan"], "--areas must lie within 1 and 1e7 m2"),
        (["merge", "--resolution", "nan"], "--resolution within 0.001 and 100 m"),
        (["merge", "--workers", "0"], "--repeat and --workers must be positive"),
        (["scaling", "--lengths", "0"], "--lengths must lie within 1 and 1e7 m, --beams be positive"),
    ],
)
def test_wrong_usage_is_exit_2(capsys, arguments, message):
    with pytest.raises(SystemExit) as left:
        main(arguments)
    assert left.value.code == 2
    assert message in capsys.readouterr().err


def test_help_loads_nothing_heavy():
    code = "import sys; from tools.benchmark import parser; parser().print_help(); print('numpy' in sys.modules)"
    command = [sys.executable, "-c", code]
    out = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout  # noqa: S603 - a fixed command
    assert "--world office:1:good" in out
    assert out.endswith("False\n")


def test_ctrl_c_is_one_line(monkeypatch, capsys):
    def give_up(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("tools.limits_benchmark.benchmark_limits", give_up)
    assert main(["limits"]) == 130
    assert capsys.readouterr().err == "benchmark: interrupted\n"
