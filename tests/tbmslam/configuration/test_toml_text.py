import tomllib

import pytest

from tbmslam.configuration.slam_config import PRESETS, SlamConfig, config_from_dict
from tbmslam.configuration.toml_text import config_text, descriptions_of


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_read_back_from_its_text(name):
    assert config_from_dict(tomllib.loads(config_text(PRESETS[name]))) == PRESETS[name]


def test_a_parameter_has_its_meaning_unit_and_limits():
    text = config_text(SlamConfig(), "A heading.", ["motion"])
    assert text.startswith("# A heading.\n\n")
    assert "\n[map]\n# The grid and what beams write into it.\n# side of a cell [m]\n" in text
    assert "\nresolution = 0.05 # >= 0.001, <= 10\n" in text
    assert 'no_return = "ignore" # one of free, ignore\n' in text
    assert "[motion]" not in text


def test_the_docstring_describes_what_the_fields_do_not():
    class Table:
        """Something.

        Parameters
        ----------
        near_m, far_m
            How near and how far
            it may be [m].
        """

    assert descriptions_of(Table()) == dict.fromkeys(("near_m", "far_m"), "How near and how far it may be [m]")
