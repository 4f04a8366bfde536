import tomllib
from dataclasses import dataclass
from typing import Annotated

import pytest

from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import PRESETS, SlamConfig
from tbmslam.configuration.toml_text import config_text, descriptions_of


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
    config = changed(SlamConfig(), {"tracker": {"kind": "grid"}, "loop_closing": {"enabled": False}})
    text = config_text(config, reference=PRESETS["default"])
    assert changed(SlamConfig(), tomllib.loads(text)) == config
