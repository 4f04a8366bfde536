import json

import pytest

from tbmslam.configuration.parameters import changed
from tbmslam.configuration.slam_config import PRESETS, ConfigError, SlamConfig, preset


@pytest.mark.parametrize("name", PRESETS)
def test_presets_survive_a_round_trip(name):
    config = preset(name)
    assert (
        changed(config, config.model_dump(mode="json"))
        == changed(config, json.loads(config.model_dump_json()))
        == config
    )


def test_unknown_preset():
    with pytest.raises(ConfigError, match=r"no preset 'vinny'; there are default, viny, .*: did you mean 'viny'\?"):
        preset("vinny")


def test_unknown_key_and_wrong_value():
    with pytest.raises(ConfigError, match=r"no parameter 'map.resolutoin': did you mean 'map.resolution'\?"):
        changed(SlamConfig(), {"map": {"resolutoin": 0.1}})
    with pytest.raises(
        ConfigError, match=r"configuration: map.resolution: Input should be greater than or equal to 0.001 \(got -1\)"
    ):
        changed(SlamConfig(), {"map": {"resolution": -1}})


def test_a_part_of_the_tracker_needs_no_kind():
    assert changed(SlamConfig(), {"tracker": {"max_points": 300}}).tracker.max_points == 300


def test_a_part_of_a_preset_keeps_the_rest_of_it():
    assert changed(preset("viny"), {"seed": 3}) == preset("viny").model_copy(update={"seed": 3})


def test_once_per_scan_excludes_blur_and_means():
    with pytest.raises(ConfigError, match=r"wall_blur must be 0 with insertion.once_per_scan"):
        changed(SlamConfig(), {"map": {"sensor_model": {"wall_blur": 0.3}}})
    with pytest.raises(ConfigError, match=r"combination must be 'conjunctive' with insertion.once_per_scan"):
        changed(SlamConfig(), {"map": {"sensor_model": {"combination": "mean"}}})


def test_a_tracker_on_a_grid_counts_every_beam():
    said = "tracker.kind 'grid' needs map.insertion.once_per_scan=false: set both, or use preset viny"
    with pytest.raises(ConfigError, match=said):
        changed(SlamConfig(), {"tracker": {"kind": "grid"}})
    with pytest.raises(ConfigError, match=said):
        changed(preset("viny"), {"map": {"insertion": {"once_per_scan": True}, "sensor_model": {"wall_blur": 0.0}}})
