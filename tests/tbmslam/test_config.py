import pytest

from tbmslam.config import PRESETS, ConfigError, config_from_dict, preset, with_setting


@pytest.mark.parametrize("name", PRESETS)
def test_presets_survive_a_round_trip(name):
    config = preset(name)
    assert config_from_dict(config.model_dump(mode="json")) == config


def test_unknown_preset():
    with pytest.raises(ConfigError, match=r"no preset 'vinny'; there are default, viny, .*: did you mean 'viny'\?"):
        preset("vinny")


def test_unknown_key_and_wrong_value():
    with pytest.raises(ConfigError, match=r"configuration: map.resolutoin: Extra inputs"):
        config_from_dict({"map": {"resolutoin": 0.1}})
    with pytest.raises(ConfigError, match=r"configuration: map.resolution: Input should be greater than 0 \(got -1\)"):
        config_from_dict({"map": {"resolution": -1}})


def test_once_per_scan_excludes_blur_and_means():
    values = preset("default").model_dump()
    with pytest.raises(ConfigError, match=r"wall_blur must be 0 where insertion.once_per_scan is on"):
        config_from_dict(with_setting(values, "map.sensor_model.wall_blur=0.3"))
    with pytest.raises(ConfigError, match=r"combination must be 'conjunctive' where insertion.once_per_scan is on"):
        config_from_dict(with_setting(values, "map.sensor_model.combination=mean"))


def test_settings():
    values = preset("default").model_dump()
    assert config_from_dict(with_setting(values, "map.resolution=0.2")).map.resolution == 0.2
    assert config_from_dict(with_setting(values, "map.insertion.no_return=free")).map.insertion.no_return == "free"
    assert values["map"]["resolution"] == 0.05


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("map.resolution", r"must look like map.resolution=0.1"),
        ("map.resolutio=1", r"no parameter 'map.resolutio': did you mean 'resolution'\?"),
        ("seed.x=1", r"no parameter 'seed.x': seed is a value"),
    ],
)
def test_wrong_settings(setting, message):
    with pytest.raises(ConfigError, match=message):
        with_setting(preset("default").model_dump(), setting)
