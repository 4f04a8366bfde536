import sys

import pytest

from tools.benchmark import main


def test_a_recording_that_is_missing_is_one_line_and_exit_1(tmp_path, capsys):
    assert main(["slam", str(tmp_path / "none.bag")]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1].startswith("benchmark: ")
    assert "none.bag: no such file or directory" in lines[-1]


@pytest.mark.parametrize("command", ["slam", "perturb", "split"])
def test_two_recordings_of_one_name_are_an_error(tmp_path, capsys, command):
    bag = tmp_path / "a.bag"
    bag.touch()
    assert main([command, str(bag), f"{bag},odometry=none"]) == 1
    assert "two recordings are named a: rename a file, or measure one at a time" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["slam"], "slam needs recordings or --world"),
        (["slam", "a.bag", "--preset", "best"], "--preset: there is no 'best'; there are default, viny"),
        (["slam", "a.bag,angel=1"], "unrecognized arguments: --angel 1"),
        (["slam", "a.bag", "--repeat", "0"], "--repeat: must be a whole number of at least 1, got '0'"),
        (
            ["slam", "--world", "office:1:good", "--seeds", "0"],
            "--seeds: must be a whole number of at least 1, got '0'",
        ),
        (["slam", "--world", "office"], "--world must look like office:1:good, got 'office'"),
        (["slam", "--world", "castle:1:good"], "invalid choice: 'castle'"),
        (["merge", "--areas", "0"], "--areas: must be a number within 1 and 1e+07, got '0'"),
        (
            ["split", "x.bag", "--robots", "1000000"],
            "--robots: must be a whole number within 2 and 10000, got '1000000'",
        ),
        (["split", "x.bag", "--robots", "2,1"], "--robots: must be a whole number within 2 and 10000, got '1'"),
        (["split", "x.bag", "--robots", "2,,3"], "--robots: must be a whole number within 2 and 10000, got ''"),
        (["split", "x.bag", "--robots", "²"], "--robots: must be a whole number within 2 and 10000, got '²'"),
        (["split", "x.bag", "--robots", "9" * 5000], "--robots: must be a whole number within 2 and 10000, got '99"),
        (["merge", "--areas", "4900;8100"], "--areas: must be a number within 1 and 1e+07, got '4900;8100'"),
        (["scaling", "--lengths", ""], "--lengths: must be a number within 1 and 1e+07, got ''"),
        (["merge", "--areas", "4900,nan"], "--areas: must be a number within 1 and 1e+07, got 'nan'"),
        (["strangers", "--workers", "0"], "--workers: must be a whole number of at least 1"),
        (["perturb", "a.bag", "--jobs", "0"], "--jobs: must be a whole number of at least 1, got '0'"),
        (["perturb", "a.bag,angel=1"], "unrecognized arguments: --angel 1"),
        (["scaling", "--lengths", "0"], "--lengths: must be a number within 1 and 1e+07, got '0'"),
        (["fleet", "0x40"], "must be BUILDINGSxMAPS, as 30x10, of 2 to 10000 maps, got '0x40'"),
        (["limits", "--share", "2"], "--share: must be a number within 0.0001 and 1, got '2'"),
        (["align", "pairs", "--method", "best"], "--method: there is no 'best'; there are correlation, features"),
    ],
)
def test_wrong_usage_is_exit_2(usage_error, arguments, message):
    assert message in usage_error(main, arguments)


def test_the_machine_is_described_before_the_benchmark_runs(monkeypatch):
    described = []
    monkeypatch.setattr("tools.benchmarks.scaling.benchmark_limits", lambda args: described.append(args.machine))
    assert main(["limits"]) == 0
    assert described[0]["cores"] >= 1


@pytest.mark.parametrize("plot", [[], ["--plot", "fleet.png"]])
def test_a_plot_without_matplotlib_is_one_line_before_anything_runs(monkeypatch, capsys, plot):
    ran = []
    monkeypatch.setattr("tools.benchmarks.fleet.benchmark_fleet", ran.append)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["fleet", *plot]) == len(plot) // 2
    assert len(ran) == 1 - len(plot) // 2
    wanted = "benchmark: --plot needs matplotlib: pip install 'tbmslam[paper]'\n" if plot else ""
    assert capsys.readouterr().err == wanted


def test_ctrl_c_is_one_line(monkeypatch, capsys):
    def give_up(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("tools.benchmarks.scaling.benchmark_limits", give_up)
    assert main(["limits"]) == 130
    assert capsys.readouterr().err == "benchmark: interrupted\n"
