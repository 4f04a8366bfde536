"""The configuration of the programs, from a preset, a file and the command line."""

import codecs
import tomllib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Self

from datasets import RecordingOptions
from merging.config import PAPER, MergeConfig
from tbmslam.configuration.parameters import changed, config_text, parse_setting
from tbmslam.configuration.slam_config import ConfigError, SlamConfig, preset
from tbmslam.special_file import why_unreadable

_UTF_16 = codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE
_PAPER, _PAPER_SLAM = "paper", "viny"
_HEADING = "Parameters of tbmslam. Give this file, or a part of it, to `tbmslam map` or `merge` with --config."


class Configuration(SlamConfig):
    """All parameters: of the SLAM, the reading of recordings, and the merge of maps."""

    recording: RecordingOptions = RecordingOptions()
    merging: MergeConfig = MergeConfig()

    @classmethod
    def of_preset(cls, name: str) -> Self:
        """Return a preset of the SLAM with defaults for other parts; `paper` is viny with the paper's merging."""
        slam = preset(_PAPER_SLAM if name == _PAPER else name)
        merging = {"merging": PAPER} if name == _PAPER else {}
        return cls.model_validate({key: value for key, value in slam if key in SlamConfig.model_fields} | merging)

    @property
    def slam(self) -> SlamConfig:
        """The parameters of the SLAM."""
        return SlamConfig.model_validate({key: getattr(self, key) for key in SlamConfig.model_fields})

    def with_settings(self, settings: Iterable[str]) -> Self:
        """Return the configuration with changes like ``map.resolution=0.1``."""
        changes: dict[str, object] = {}
        for setting in settings:
            _add(parse_setting(setting), changes)
        if "preset" in changes:
            raise ConfigError("a preset is not set with --set: choose it with --preset")
        return changed(self, changes, "--set")  # as a whole, since values may depend on each other


def _add(change: Mapping[str, object], changes: dict[str, object]) -> None:
    """Add nested tables of parameters to others; the last value of a parameter counts."""
    for key, value in change.items():
        table = changes.get(key)
        if isinstance(value, dict) and isinstance(table, dict):
            _add(value, table)
        else:
            changes[key] = value


def read_configuration(preset_name: str | None, file: Path | None) -> Configuration:
    """Return the configuration of a preset, changed by a file or by the config.toml of a folder.

    Without a preset name, the preset of the file is used.
    """
    if file is None:
        return Configuration.of_preset("default" if preset_name is None else preset_name)
    path = file / "config.toml" if file.is_dir() else file
    changes = _read(path)
    named = changes.get("preset")
    if preset_name is not None and named not in (None, preset_name):
        raise ConfigError(f"{path}: holds the preset {named!r}: drop --preset {preset_name} or that line")
    config = Configuration.of_preset(str(named or ("default" if preset_name is None else preset_name)))
    return changed(config, {**changes, "preset": config.preset}, str(path))


def whole_text(config: Configuration, leave_out: Collection[str] = ()) -> str:
    """Return the public parameters but some, and constants that differ from the preset's, as TOML."""
    return config_text(config, _HEADING, leave_out, Configuration.of_preset(config.preset))


def mapping_text(config: Configuration) -> str:
    """Return the parameters that a map depends on, as TOML."""
    return whole_text(config, ["merging"])


def merging_text(config: MergeConfig) -> str:
    """Return the parameters that a merge depends on, as TOML."""
    return whole_text(Configuration(merging=config), [*SlamConfig.model_fields, "recording"])


def _read(path: Path) -> Mapping[str, object]:
    if why := "is no file but a folder" if path.is_dir() else why_unreadable(path):
        raise ConfigError(f"{path}: cannot be read as TOML: it {why}")
    try:
        data = path.read_bytes()
        # `tbmslam config > FILE` in PowerShell of Windows writes UTF-16.
        return tomllib.loads(data.decode("utf-16" if data.startswith(_UTF_16) else "utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:  # ValueError also for numbers of thousands of digits
        reason = (isinstance(error, OSError) and error.strerror) or error
        raise ConfigError(f"{path}: cannot be read as TOML: {reason}") from None
