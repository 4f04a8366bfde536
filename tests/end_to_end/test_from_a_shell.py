"""The programs as a shell runs them: exit codes, one line on stderr, the same bytes from another process and folder."""

import os
import shutil

import pytest

from tbmslam import commands
from tests.end_to_end.programs import contents
from tests.processes import ROOT, cpu_seconds, python
from tools import build_maps

COMMANDS = {program: command for command, (program, _) in commands.PROGRAMS.items()}
PROGRAMS = ("build_maps", "merge", "make_world", "evaluate", "benchmark", "download")

pytestmark = pytest.mark.xdist_group("flat")


def program_path(program):
    return ROOT / "tools" / f"{program}.py"


# A cache without this version of the kernels; the tests may be the first to compile them.
COMPILING = "compiling for this machine: a minute or two, the first time only\n"


def shell(program, *arguments, **how):
    return python(program_path(program), *arguments, **how)


def run(capsys, bag, maps):
    """Map a bag in this process; return the exit code and what is printed on stdout and stderr."""
    capsys.readouterr()
    return build_maps.main([str(bag), "-o", str(maps)]), *capsys.readouterr()


def test_another_process_in_another_folder_gives_the_same_bytes(flat, flat_maps, flat_merged, tmp_path):
    bags = [str(flat / f"robot_{k}.bag") for k in range(2)]
    done = shell("build_maps", *bags, "--separate", "-o", "maps", cwd=tmp_path, PYTHONHASHSEED="7")
    assert (done.returncode, done.stderr.removeprefix(COMPILING)) == (0, "")
    assert contents(tmp_path / "maps") == contents(flat_maps)
    done = shell("merge", "maps/robot_0", "maps/robot_1", "-o", "merged", cwd=tmp_path, PYTHONHASHSEED="7")
    assert (done.returncode, done.stderr.removeprefix(COMPILING)) == (0, "")
    assert done.stdout.splitlines()[-1] == "merged robot_0, robot_1 into merged"
    assert contents(tmp_path / "merged") == contents(flat_merged)


def test_a_missing_bag_and_a_missing_map_are_exit_1(tmp_path):
    for program, arguments in {"build_maps": ["none.bag"], "merge": ["none_0", "none_1"]}.items():
        done = shell(program, *arguments, "-o", "out", cwd=tmp_path)
        assert done.returncode == 1
        assert done.stderr.startswith(f"{program}: none")
        assert done.stderr.count("\n") == 1
        assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("program", PROGRAMS)
def test_wrong_usage_is_exit_2(program):
    done = shell(program, "--no-such-option")
    assert done.returncode == 2
    assert done.stderr.startswith(f"{program}: error: ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("program", PROGRAMS)
def test_help_is_quick_and_shows_two_examples_and_the_exit_codes(program):
    done, seconds = cpu_seconds(program_path(program), "--help", enough=0.3)
    assert done.returncode == 0
    assert done.stdout.count(f"\n  tbmslam {COMMANDS[program]} ") >= 2
    assert "exit codes: 0 " in done.stdout
    assert seconds < 0.3


def test_a_bag_of_another_format_is_one_line_and_exit_1(shared_data, tmp_path, capsys):
    bag = shared_data / "broken" / "rosbag-v1.2.bag"
    code, out, err = run(capsys, bag, tmp_path / "maps")
    assert code == 1
    assert out == ""
    assert err.startswith(f"build_maps: {bag}: a bag of version 'ROSRECORD V1.2', only V2.0 can be read: ")
    assert err.count("\n") == 1
    assert not (tmp_path / "maps").exists()


@pytest.mark.parametrize(
    ("name", "fact"),
    [
        ("truncated-intel.bag", "the bag is cut off or its index is damaged"),
        ("wrong-index-length.bag", "the index of the bag contradicts itself"),
    ],
)
def test_a_damaged_bag_gives_its_readable_part_with_a_warning(shared_data, tmp_path, name, fact):
    bag = shared_data / "broken" / name
    done = shell("build_maps", bag, "-o", tmp_path / "maps")
    assert done.returncode == 0
    warned = [line for line in done.stderr.splitlines() if f"{bag}: {fact}; " in line]
    assert len(warned) == 1
    assert " scans were read" in warned[0]
    assert (tmp_path / "maps" / bag.stem / "map.npz").is_file()


def test_every_broken_file_is_known_here(shared_data):
    known = {"rosbag-v1.2.bag", "truncated-intel.bag", "wrong-index-length.bag", "escape_in_frame_names.bag"}
    assert {path.name for path in (shared_data / "broken").iterdir()} == known


@pytest.mark.parametrize("share", [0.0, 0.001])
def test_a_bag_cut_before_its_first_scan_is_one_line_and_exit_1(flat, tmp_path, capsys, share):
    code, _, err = run(capsys, cut_bag(flat, tmp_path, share), tmp_path / "maps")
    assert code == 1
    assert err.startswith(f"build_maps: {tmp_path / 'cut.bag'}: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize("share", [0.3, 0.999])
def test_a_bag_cut_later_is_mapped_as_far_as_it_goes(flat, tmp_path, share):
    done = shell("build_maps", cut_bag(flat, tmp_path, share), "-o", tmp_path / "maps")
    assert done.returncode == 0
    assert done.stderr.startswith(f"{tmp_path / 'cut.bag'}: the bag is cut off or its index is damaged; ")
    assert done.stderr.endswith(" lost\n")
    assert done.stderr.count("\n") == 1


def cut_bag(flat, folder, share):
    """Return a copy of the first robot's bag of which only the first share is left."""
    whole = flat / "robot_0.bag"
    cut = folder / "cut.bag"
    shutil.copy(whole, cut)
    os.truncate(cut, int(whole.stat().st_size * share))
    return cut
