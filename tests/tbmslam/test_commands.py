import shutil
import subprocess
import tomllib

import pytest

from tbmslam.commands import PROGRAMS, main
from tests.processes import ROOT, cpu_seconds, python
from tools.command_line.configuration import read_configuration, whole_text


def test_help_names_every_command_and_is_quick():
    done, seconds = cpu_seconds("-m", "tbmslam", "--help", enough=0.2)
    assert done.returncode == 0
    assert all(f"\n  {command} " in done.stdout and about in done.stdout for command, (_, about) in PROGRAMS.items())
    assert seconds < 0.2


def test_a_wrong_path_is_reported_before_heavy_imports():
    for words, line in (
        (("map", "none.bag"), "tbmslam map: none.bag: no such file or directory: check the path\n"),
        (
            ("merge", "none_0", "none_1", "-o", "x"),
            "tbmslam merge: none_0: does not exist: give a map's folder or file\n",
        ),
        (
            ("evaluate", "trajectory", "none.tum", "--truth", "none.tum"),
            "tbmslam evaluate: none.tum: no such file or directory: check the path\n",
        ),
        (
            ("evaluate", "map", ".", "--truth", "none.npz"),
            "tbmslam evaluate: none.npz: no such file or directory: check the path\n",
        ),
        (
            ("map", __file__, "--reference", "none.tum", "-o", "x"),
            "tbmslam map: none.tum: no such file or directory: check the path\n",
        ),
        (
            ("merge", __file__, __file__, "--config", "none.toml", "-o", "x"),
            "tbmslam merge: none.toml: no such file or directory: check the path\n",
        ),
        (
            ("config", "--config", "none.toml"),
            "tbmslam config: none.toml: no such file or directory: check the path\n",
        ),
        (("download", "none"), "tbmslam download: there is no known recording 'none': see --list\n"),
    ):
        done, seconds = cpu_seconds("-m", "tbmslam", *words, enough=0.3)
        assert (done.returncode, done.stderr) == (1, line)
        assert seconds < 0.3


def test_a_benchmark_of_no_recording_is_refused_before_any_is_mapped(tmp_path, capsys):
    for name in ("slam", "split", "perturb"):
        assert main(["benchmark", name, f"{tmp_path}/none.bag,scan_topic=/scan"]) == 1
        assert capsys.readouterr().err == (
            f"tbmslam benchmark: {tmp_path}/none.bag: no such file or directory: check the path\n"
        )


@pytest.mark.parametrize("command", PROGRAMS)
def test_no_help_speaks_of_files_that_only_a_clone_has(command, capsys):
    inner = {"evaluate": ("trajectory", "map"), "benchmark": ("slam", "align", "split", "perturb")}.get(command, ())
    for words in ([command], *([command, name] for name in inner)):
        with pytest.raises(SystemExit):
            main([*words, "--help"])
        printed = capsys.readouterr().out
        files = [program for program, _ in PROGRAMS.values() if "_" in program]
        assert not [file for file in files if file in printed]
        assert "datasets/" not in printed


@pytest.mark.parametrize("command", PROGRAMS)
def test_each_command_runs_its_program_under_its_own_name(command, capsys):
    with pytest.raises(SystemExit) as left:
        main([command, "--help"])
    assert left.value.code == 0
    printed = capsys.readouterr().out
    assert printed.startswith(f"usage: tbmslam {command}")
    assert printed.count(f"\n  tbmslam {command} ") >= 1
    assert f"tools/{PROGRAMS[command][0]}.py" not in printed
    with pytest.raises(SystemExit) as left:
        main([command, "--no-such-option"])
    assert left.value.code == 2
    assert capsys.readouterr().err.startswith(f"tbmslam {command}: error: ")


def test_the_version_is_that_of_the_project(capsys):
    assert main(["--version"]) == 0
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert capsys.readouterr().out in (
        f"tbmslam {project['version']}\n",
        "tbmslam of a source tree that is not installed\n",
    )


@pytest.mark.parametrize(("words", "what"), [([], "a command is missing"), (["mapp"], "there is no command 'mapp'")])
def test_no_command_is_one_line_that_names_them_all(words, what, capsys):
    assert main(words) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"tbmslam: error: {what}; there are map, merge, ")
    assert said.count("\n") == 1


def test_config_prints_every_parameter(capsys):
    assert main(["config", "--set", "map.resolution=0.1"]) == 0
    printed = capsys.readouterr().out
    assert printed == whole_text(read_configuration(None, None).with_settings(["map.resolution=0.1"]))
    assert tomllib.loads(printed)["map"]["resolution"] == 0.1


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_commands_and_options(tmp_path, capsys):
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "completion.bash"
    script.write_text(capsys.readouterr().out, encoding="utf-8")
    for typed, wanted in ((["ma"], "map"), (["merge", "--rul"], "--rule"), (["evaluate", "traj"], "trajectory")):
        words = " ".join(f"'{word}'" for word in ("tbmslam", *typed))
        ask = (
            f"source {script}; COMP_WORDS=({words}); COMP_CWORD={len(typed)}; "
            r"$(complete -p tbmslam | sed 's/.*-F \([^ ]*\).*/\1/') tbmslam; echo ${COMPREPLY[@]}"
        )
        done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)  # noqa: S603, S607
        assert wanted in done.stdout.split(), done.stderr


@pytest.mark.slow
def test_warming_up_compiles_once(tmp_path, monkeypatch):
    def warm_up():
        done = python("-m", "tbmslam", "warm-up", NUMBA_CACHE_DIR=str(tmp_path))
        return int(done.stdout.split(" functions compiled in ")[0].splitlines()[-1])

    assert warm_up() > 50
    assert warm_up() < 10
