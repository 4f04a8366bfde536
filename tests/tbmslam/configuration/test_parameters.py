import tomllib
from dataclasses import dataclass
from typing import Annotated

import pytest

from tbmslam.configuration.parameters import (
    ConfigError,
    changed,
    config_text,
    descriptions_of,
    parameter_names,
    parse_setting,
)
from tbmslam.configuration.slam_config import PRESETS, SlamConfig, preset
from tbmslam.related.viny_tracker import GridTrackerConfig, HillClimbingConfig


def test_what_is_not_named_stays():
    config = changed(preset("viny"), {"map": {"resolution": 0.2}})
    assert config.map.resolution == 0.2
    assert config.map.insertion == preset("viny").map.insertion
    assert config.tracker == preset("viny").tracker
    assert preset("viny").map.resolution == 0.1


def test_part_of_a_table_that_has_kinds_needs_no_kind():
    config = changed(SlamConfig(), {"tracker": {"max_points": 300, "surfels": {"noise": 0.03}}})
    assert (config.tracker.kind, config.tracker.max_points, config.tracker.surfels.noise) == ("surfels", 300, 0.03)
    assert config.tracker.surfels.resolution == 0.1


EVERY_BEAM = {"insertion": {"once_per_scan": False}}  # which the tracker on a grid needs


def test_another_kind_begins_with_its_defaults():
    matcher = {"tracker": {"kind": "grid", "matcher": {"method": "hill_climbing"}}}
    config = changed(SlamConfig(), {"map": EVERY_BEAM, **matcher})
    assert config.tracker == GridTrackerConfig(matcher=HillClimbingConfig())


def test_values_are_checked_again_together():
    with pytest.raises(ConfigError, match=r"^mine\.toml: map: .*wall_blur must be 0 with insertion\.once_per_scan"):
        changed(SlamConfig(), {"map": {"sensor_model": {"wall_blur": 0.3}}}, "mine.toml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mpa": {}}, r"^configuration: there is no parameter 'mpa': did you mean 'map'\?$"),
        ({"map": {"resolutoin": 1}}, r"there is no parameter 'map\.resolutoin': did you mean 'map\.resolution'\?"),
        ({"once_per_scan": True}, r"no parameter 'once_per_scan': did you mean 'map\.insertion\.once_per_scan'\?"),
        ({"tracker": {"matcher": {}}}, r"there is no parameter 'tracker\.matcher': "),
        ({"keyframes": {"0": 1}}, r"there is no parameter 'keyframes\.0': keyframes has distance, angle$"),
        ({"map": 3}, r"^configuration: map is a table: name one of its parameters, as map\.resolution$"),
        ({"tracker": {"kind": "magic"}}, r"tracker: .*'magic'.*does not match any of the expected tags"),
        (
            {"tracker": {"iterations": 0}},
            r"^configuration: tracker\.iterations: .*greater than or equal to 1 \(got 0\)$",
        ),
        ({"seed": 1.5}, r"^configuration: seed: .*valid integer.* \(got 1\.5\)$"),
        ({"seed": "many"}, r"^configuration: seed must be a number, got 'many'$"),
        ({"map": {"resolution": True}}, r"^configuration: map\.resolution must be a number, got True$"),
        ({"map": {"keep_conflict": "no"}}, r"^configuration: map\.keep_conflict must be true or false, got 'no'$"),
        ({"map": {"keep_conflict": 1}}, r"^configuration: map\.keep_conflict must be true or false, got 1$"),
        ({"seed": "7"}, r"^configuration: seed must be a number, got '7'$"),
    ],
)
def test_what_is_wrong_is_named_with_the_nearest(changes, message):
    with pytest.raises(ConfigError, match=message):
        changed(SlamConfig(), changes)


@pytest.mark.parametrize(
    ("text", "change"),
    [
        ("map.resolution=0.1", {"map": {"resolution": 0.1}}),
        ("map.insertion.no_return=free", {"map": {"insertion": {"no_return": "free"}}}),
        ("tracker.tolerances=[9.0, 2.0]", {"tracker": {"tolerances": [9.0, 2.0]}}),
        ("loop_closing.enabled=false", {"loop_closing": {"enabled": False}}),
    ],
)
def test_settings(text, change):
    assert parse_setting(text) == change


@pytest.mark.parametrize("text", ["map.resolution", "=1", "map.=1", ""])
def test_what_is_no_setting(text):
    with pytest.raises(ConfigError, match=r"must look like map\.resolution=0\.1"):
        parse_setting(text)


def test_names():
    names = list(parameter_names(SlamConfig()))
    assert {"seed", "map", "map.insertion.no_return", "tracker.surfels.noise"} <= set(names)
    assert len(names) == len(set(names))


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_read_back_from_its_text(name):
    assert changed(SlamConfig(), tomllib.loads(config_text(PRESETS[name]))) == PRESETS[name]


def test_a_parameter_has_its_meaning_unit_and_limits():
    text = config_text(SlamConfig(), "A heading.", ["motion"])
    assert text.startswith("# A heading.\n\n")
    assert "\n[map]\n# Parameters of the grid and of the insertion of beams.\n# side of a cell [m]\n" in text
    assert "\nresolution = 0.05 # >= 0.001, <= 10\n" in text
    assert 'no_return = "ignore" # one of free, ignore\n' in text
    assert "[motion]" not in text


def test_fields_of_a_dataclass_are_described_by_their_types():
    @dataclass
    class Table:
        near_m: Annotated[float, "least distance [m]"] = 1.0
        name: str = ""

    assert descriptions_of(Table()) == {"near_m": "least distance [m]", "name": ""}


def test_constants_are_printed_where_they_differ():
    reference = PRESETS["default"]
    assert "novel" not in config_text(reference, reference=reference)
    text = config_text(changed(SlamConfig(), {"tracker": {"novel": 0.3}}), reference=reference)
    assert tomllib.loads(text)["tracker"]["novel"] == 0.3


@pytest.mark.parametrize("name", PRESETS)
def test_what_a_user_sees_of_a_preset_is_read_back(name):
    text = config_text(PRESETS[name], reference=PRESETS[name])
    assert changed(PRESETS[name], tomllib.loads(text)) == PRESETS[name]
    assert len(text.splitlines()) < 120


def test_another_kind_of_table_is_printed_and_read_back():
    config = changed(SlamConfig(), {"tracker": {"kind": "grid"}, "map": EVERY_BEAM, "loop_closing": {"enabled": False}})
    text = config_text(config, reference=PRESETS["default"])
    assert changed(SlamConfig(), tomllib.loads(text)) == config
