import dataclasses

import pytest

from datasets import downloading
from tools import build_maps, download
from tools.command_line.output_folder import output_folder


def test_the_list_is_honest_about_what_was_tried(capsys):
    assert download.main(["--list"]) == 0
    out = capsys.readouterr().out
    assert "  stata/2011-01-24-06-18-27          242 MB  PR2, 225 s, 4489 scans *\n" in out
    assert (
        "  ccny/demo                         1.03 MB  a room, 360 scans of a hand-held Hokuyo, no odometry *\n" in out
    )
    assert "licence: CC BY 3.0" in out
    assert "  truth: true poses of the laser for 17 drives (BAG_partN_floor2.gt.laser.poses) and the floor plans" in out
    assert out.count("  truth: ") == 1
    assert "cite: M. Fallon" in out
    assert out.endswith("\nAddresses marked with * were never tested.\n")


def test_a_list_of_tried_addresses_has_no_note(monkeypatch, capsys):
    tried = {"a": dataclasses.replace(downloading.known_recording("freiburg/intel"), reached=True)}
    monkeypatch.setattr(downloading, "known_recordings", lambda: tried)
    assert download.main(["--list"]) == 0
    assert "*" not in capsys.readouterr().out


def test_a_recording_is_put_where_the_next_command_finds_it(tmp_path, monkeypatch, capsys):
    asked = []

    def fetched(address, path, sha256, _progress):
        asked.append((address, sha256))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
        return True

    monkeypatch.setattr(downloading, "download", fetched)
    monkeypatch.chdir(tmp_path)
    assert download.main(["stata/2011-01-24-06-18-27", "freiburg/intel"]) == 0
    assert asked[0] == ("http://infinity.csail.mit.edu/data/2011/2011-01-24-06-18-27.bag", None)
    assert (tmp_path / "recordings" / "freiburg" / "intel.relations").is_file()
    command = capsys.readouterr().out.split("next: tbmslam map ")[1].splitlines()[0]
    args = build_maps.parser().parse_args(command.split())
    assert args.recordings[0].is_file()
    assert args.profile == "stata"


def test_the_small_one_arrives_whole_and_with_its_licence(tmp_path, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(downloading, "download", lambda *what: bool(asked.append(what[:3])))
    monkeypatch.chdir(tmp_path)
    assert download.main(["ccny/demo"]) == 0
    ((address, path, sha256),) = asked
    assert address.startswith("https://raw.githubusercontent.com/CCNYRoboticsLab/scan_tools/")
    assert address.endswith("/laser_scan_matcher/demo/demo.bag")
    assert (path.as_posix(), len(sha256)) == ("recordings/ccny/demo.bag", 64)
    out = capsys.readouterr().out
    assert "licence: BSD 3-Clause; cite: I. Dryanovski" in out
    assert "see https://github.com/CCNYRoboticsLab/scan_tools/" in out
    assert "  next: tbmslam map recordings/ccny/demo.bag -o out/demo\n" in out


def test_a_server_that_does_not_answer_is_one_line_that_names_the_page(tmp_path, monkeypatch, capsys):
    recording = dataclasses.replace(downloading.known_recording("freiburg/intel"), addresses=("http://127.0.0.1:1/x",))
    monkeypatch.setattr(downloading, "known_recordings", lambda: {"freiburg/intel": recording})
    assert download.main(["freiburg/intel", "-o", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert error.startswith("download: http://127.0.0.1:1/x: the connection failed after 0 bytes")
    assert error.endswith("(http://ais.informatik.uni-freiburg.de/slamevaluation/datasets.php)\n")
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_unknown_name_is_exit_1_and_nothing_at_all_is_exit_2(capsys):
    assert download.main(["intel"]) == 1
    assert capsys.readouterr().err == "download: there is no known recording 'intel': did you mean freiburg/intel?\n"
    with pytest.raises(SystemExit) as left:
        download.main([])
    assert left.value.code == 2


def test_two_runs_do_not_add_to_one_file(tmp_path, capsys):
    with output_folder(tmp_path):
        assert download.main(["freiburg/intel", "-o", str(tmp_path)]) == 1
    assert "another run is writing there" in capsys.readouterr().err
