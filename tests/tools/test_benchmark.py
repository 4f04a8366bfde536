import subprocess
import sys
from pathlib import Path

import pytest

from tools.benchmark import main

ROOT = Path(__file__).resolve().parents[2]


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
        (
            ["split", "x.bag", "--robots", "1000000"],
            "--robots must be numbers within 2 and 10000, as 2,3,5, got 1000000",
        ),
        (["split", "x.bag", "--robots", "2,1"], "--robots must be numbers within 2 and 10000"),
        (["split", "x.bag", "--robots", "2,,3"], "--robots must be numbers within 2 and 10000"),
        (["split", "x.bag", "--robots", "²"], "--robots must be numbers within 2 and 10000"),
        (["split", "x.bag", "--robots", "9" * 5000], "--robots must be numbers within 2 and 10000"),
        (["merge", "--robots", "1000000"], "--robots within 0 and 10000"),
        (["merge", "--areas", "4900;8100"], "--areas must be numbers with commas between, got '4900;8100'"),
        (["scaling", "--lengths", ""], "--lengths must be numbers with commas between, got ''"),
        (["merge", "--areas", "4900,nan"], "--areas must lie within 1 and 1e7 m2"),
        (["merge", "--resolution", "nan"], "--resolution within 0.001 and 100 m"),
        (["merge", "--workers", "0"], "--repeat and --workers must be positive"),
        (["perturb", "a.bag", "--jobs", "0"], "--jobs must be at least 1, got 0"),
        (["perturb", "a.bag,angel=1"], "unrecognized arguments: --angel 1"),
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

    monkeypatch.setattr("tools.benchmarks.scaling.benchmark_limits", give_up)
    assert main(["limits"]) == 130
    assert capsys.readouterr().err == "benchmark: interrupted\n"
