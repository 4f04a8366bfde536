import pytest

from merging.config import MergeConfig
from merging.verification import examine
from merging.walls import WallMap
from tools.make_map_pairs import main
from tools.map_pairs.known_pair import load_pair


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--area", "nan"], "--area: must be a number within 1 and 100000, got 'nan'"),
        (["--lattice", "-5"], "--lattice: must be a number within 1 and 100000, got '-5'"),
        (["--lattice", "1e12"], "--lattice: must be a number within 1 and 100000, got '1e12'"),
        (["--floor", "../x=map"], "--floor must be NAME=PATH with a name of letters, digits, dots and dashes"),
        (["--floor", "a_b=map"], "--floor must be NAME=PATH"),
        (["--floor", "map"], "--floor must be NAME=PATH"),
        (["--floor", "x="], "--floor must be NAME=PATH"),
        (["--seeds", "3", "-1"], "--seeds: must be a whole number of at least 0, got '-1'"),
        (["--parts", "1000000"], "--parts: must be a whole number within 0 and 1000, got '1000000'"),
        (["--largest", "nan"], "--largest: must be a number of at least 1e-06, got 'nan'"),
        (["--overlap", "50", "101"], "--overlap: must be a whole number within 1 and 100, got '101'"),
        (["--bend", "0"], "--bend: must be a number within 1e-06 and 2, got '0'"),
        (["--bend", "2.5"], "--bend: must be a number within 1e-06 and 2, got '2.5'"),
        (["--bend", "nan"], "--bend: must be a number within 1e-06 and 2, got 'nan'"),
        (["-o", ""], "the name of a file is empty"),
    ],
)
def test_wrong_usage_is_exit_2_and_writes_nothing(tmp_path, usage_error, arguments, message):
    assert message in usage_error(main, ["-o", str(tmp_path / "out"), *arguments])
    assert not (tmp_path / "out").exists()


def test_a_floor_that_is_not_there_is_one_line_and_exit_1(tmp_path, capsys):
    assert main(["-o", str(tmp_path / "out"), "--floor", f"x={tmp_path / 'none'}"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("make_map_pairs: ")
    assert "does not exist" in said
    assert said.count("\n") == 1


def test_pairs_with_a_larger_distortion_show_the_same_places(tmp_path):
    for name, more in (("usual", []), ("bent", ["--bend", "0.4"])):
        out = ["-o", str(tmp_path / name), "--world", "apartment", "--seeds", "3", "--area", "60", "--overlap", "100"]
        assert main([*out, *more]) == 0
    usual, bent = (load_pair(next((tmp_path / name).glob("crop_*.npz"))) for name in ("usual", "bent"))
    apart = agreement(usual), agreement(bent)
    assert apart[0] > 0.75
    assert apart[1] < apart[0] - 0.15


def agreement(pair):
    config = MergeConfig()
    structures = [WallMap.from_grid(one.grid, config.structure) for one in (pair.target, pair.source)]
    return examine(*structures, pair.T_target_source, config.verification).agreement
