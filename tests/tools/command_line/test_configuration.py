import re
import tomllib

import pytest
import tomlkit

from datasets import RecordingOptions
from merging.config import MergeConfig
from tbmslam.configuration.parameters import changed, descriptions_of, fields_of, is_table
from tbmslam.configuration.slam_config import ConfigError, preset
from tbmslam.geometry.se2 import SE2
from tools import build_maps, merge
from tools.command_line.configuration import Configuration, mapping_text, merging_text, read_configuration, whole_text

ODD = {
    "recording": {"sensor_pose": [1.0, 2.0, 0.5], "tf_topics": ["/a"], "upside_down": True, "range_max": 20.0},
    "merging": {"reliability": {"robot 0": 0.5}, "merged_resolution": 0.1},
    "tracker": {"max_points": 300},
}


def leaves(table, above=""):
    for name, value in fields_of(table).items():
        if is_table(value):
            yield from leaves(value, f"{above}{name}.")
        else:
            yield above + name, descriptions_of(table).get(name)


@pytest.mark.parametrize("name", ["default", "viny", "viny-hc"])
def test_every_parameter_is_described(name):
    chosen = {"tracker.kind", "tracker.matcher.method"}
    assert [leaf for leaf, text in leaves(Configuration.of_preset(name)) if not text and leaf not in chosen] == []


def test_a_preset_is_the_slam_s_with_the_libraries_other_defaults():
    config = Configuration.of_preset("viny")
    assert (config.slam, config.recording, config.merging) == (preset("viny"), RecordingOptions(), MergeConfig())


def test_the_preset_paper_maps_as_viny_and_merges_as_the_paper(tmp_path):
    config = Configuration.of_preset("paper")
    assert (config.slam, config.recording) == (preset("viny"), RecordingOptions())
    merging = config.merging
    assert (merging.method, merging.rule, merging.coverage) == ("dobrokhvalov-filatov", "disjunctive", "overlap")
    assert (merging.features.descriptor, merging.features.keypoints, merging.features.ratio) == (
        "concatenated",
        1000,
        0.7,
    )
    assert not merging.joint.enabled
    assert not merging.nonrigid.enabled
    (tmp_path / "config.toml").write_text(whole_text(config))
    assert read_configuration(None, tmp_path) == config
    (tmp_path / "named.toml").write_text('preset = "paper"\n')
    assert read_configuration(None, tmp_path / "named.toml") == config


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_file_is_read_as_the_shells_and_editors_of_windows_write_it(tmp_path, encoding):
    config = changed(Configuration.of_preset("default"), ODD)
    (tmp_path / "mine.toml").write_text(whole_text(config), encoding, newline="\r\n")
    assert read_configuration(None, tmp_path / "mine.toml") == config


def test_the_text_is_read_back(tmp_path):
    config = changed(Configuration.of_preset("default"), ODD)
    (tmp_path / "config.toml").write_text(whole_text(config))
    for given in (tmp_path, tmp_path / "config.toml"):
        assert read_configuration(None, given) == config
    assert config.recording.sensor_pose == SE2(1.0, 2.0, 0.5)


def test_results_keep_the_part_that_counted(tmp_path):
    config = changed(Configuration.of_preset("viny"), ODD | {"tracker": {}})
    of_map, of_merge = tomllib.loads(mapping_text(config)), tomllib.loads(merging_text(config.merging))
    assert {"preset", "map", "recording"} < set(of_map) <= set(Configuration.model_fields) - {"merging"}
    assert set(of_merge) == {"merging"}
    (tmp_path / "both.toml").write_text(mapping_text(config) + merging_text(config.merging))
    assert read_configuration(None, tmp_path / "both.toml") == config


def test_a_file_names_its_preset(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('preset = "viny"\n[map]\nresolution = 0.2\n')
    config = read_configuration(None, file)
    assert config == read_configuration("viny", file)
    assert (config.map.resolution, config.tracker.kind) == (0.2, "grid")
    with pytest.raises(ConfigError, match=r"mine\.toml: holds the preset 'viny': drop --preset default or that line"):
        read_configuration("default", file)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("preset=viny", "choose it with --preset"),
        (
            "recording.range_mx=3",
            r"--set: there is no parameter 'recording\.range_mx': did you mean 'recording\.range_max'",
        ),
        ("recording.range_max=-3", r"--set: recording: .*range_max must be positive, got -3"),
        ("recording.profile=mars", r"--set: recording\.profile: .*'auto'"),
        ("min_confidence=1", r"did you mean 'merging\.verification\.min_confidence'\?"),
        ("merging.verification.min_confidence=2", r"merging\.verification\.min_confidence: .*less than or equal to 1"),
    ],
)
def test_wrong_settings(setting, message):
    with pytest.raises(ConfigError, match=message):
        Configuration().with_settings([setting])


def test_settings_may_depend_on_each_other_in_any_order():
    settings = ["tracker.kind=grid", "map.insertion.once_per_scan=false"]
    config = Configuration().with_settings(settings)
    assert config.tracker.kind == "grid"
    assert Configuration().with_settings(settings[::-1]) == config
    assert Configuration().with_settings(["seed=1", "seed=2"]).seed == 2


@pytest.mark.parametrize("program", [build_maps, merge])
def test_print_config_prints_what_would_count_and_config_takes_it(program, tmp_path, capsys):
    words = ["--preset", "viny-hc", "--set", "merging.rule=yager", "--set", "recording.gap_s=3"]
    assert program.main([*words, "--print-config"]) == 0
    text = capsys.readouterr().out
    (tmp_path / "all.toml").write_text(text)
    assert program.main(["--config", str(tmp_path / "all.toml"), "--print-config"]) == 0
    assert capsys.readouterr().out == text
    config = read_configuration(None, tmp_path / "all.toml")
    assert (config.preset, config.merging.rule, config.recording.gap_s) == ("viny-hc", "yager", 3.0)


def given(name, value):
    """Return the change that sets one parameter."""
    for key in reversed(name.split(".")):
        value = {key: value}
    return value


def said_of_true(config, leaf):
    """Return what is said when true is given for a parameter; nothing where it is one."""
    try:
        made = changed(config, given(leaf, True), "mine.toml")
    except ConfigError as error:
        return str(error)
    for key in leaf.split("."):
        made = fields_of(made)[key]
    return "" if made is True else f"became {made}"


def test_no_number_of_all_may_be_a_truth():
    config = Configuration.of_preset("default")
    named = [leaf for leaf, _ in leaves(config) if leaf.rpartition(".")[2] not in {"kind", "method"}]
    said = {leaf: said_of_true(config, leaf) for leaf in named}
    refused = {leaf: line for leaf, line in said.items() if line}
    assert len(refused) > 150
    assert [line for leaf, line in refused.items() if not line.startswith(f"mine.toml: {leaf}") or "\n" in line] == []


@pytest.mark.parametrize(
    ("leaf", "value", "place"),
    [
        ("merging.merged_resolution", True, "merging.merged_resolution must be a number, got True"),
        ("merging.resolution", "0.1", "merging.resolution must be a number, got '0.1'"),
        ("merging.reliability", {"robot_0": True}, "merging.reliability.robot_0 must be a number, got True"),
        ("recording.sensor_pose", [True, 0.0, 0.0], "recording.sensor_pose must be a number, got True"),
        ("recording.no_return_codes", [True], "recording.no_return_codes must be a number, got True"),
        ("recording.upside_down", 1, "recording.upside_down must be true or false, got 1"),
        ("tracker.tolerances", [True, 4.0], "tracker.tolerances must be a number, got True"),
    ],
)
def test_a_truth_where_nothing_or_several_numbers_stand_is_named(tmp_path, leaf, value, place):
    (tmp_path / "mine.toml").write_text(tomlkit.dumps(given(leaf, value)))
    with pytest.raises(ConfigError, match=f"^.*mine.toml: {re.escape(place)}$"):
        read_configuration(None, tmp_path / "mine.toml")


def test_a_whole_number_is_a_number_anywhere():
    config = changed(Configuration.of_preset("default"), given("merging.merged_resolution", 1))
    assert config.merging.merged_resolution == 1.0


def test_an_empty_preset_is_none(tmp_path):
    with pytest.raises(ConfigError, match="there is no preset ''"):
        read_configuration("", None)


def test_a_map_has_a_thousand_cells_at_least():
    with pytest.raises(ConfigError, match=r"map\.max_cells: Input should be greater than or equal to 1000"):
        changed(Configuration.of_preset("default"), given("map.max_cells", 1))
