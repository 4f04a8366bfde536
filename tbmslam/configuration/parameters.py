"""Parameters of nested configurations: their dotted names and their changes."""

import dataclasses
import difflib
import reprlib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar, cast, get_args

from pydantic import BaseModel, ValidationError

from tbmslam.errors import TbmSlamError

Config = TypeVar("Config", bound=BaseModel)


class ConfigError(TbmSlamError):
    """A configuration that cannot be used."""


def changed(config: Config, changes: Mapping[str, object], source: str = "configuration") -> Config:
    """Return a configuration with new values from nested tables, as from TOML.

    If a table may be of several kinds, as the tracker, another `kind` starts with the defaults of that kind. A
    `ConfigError` names the `source` of an unknown key, with the most similar key, or of an invalid value.
    """
    names = list(parameter_names(config))
    try:
        made = type(config).model_validate(_overlaid(config, changes, (), names, source))
    except ValidationError as error:
        first = error.errors()[0]
        place = _place(config, first["loc"])
        given = "" if place == "" else f" (got {reprlib.repr(first['input'])})"
        raise ConfigError(f"{source}: {place or 'as a whole'}: {first['msg']}{given}") from None
    _check_kinds(changes, made, (), source)
    return made


def parse_setting(text: str) -> dict[str, object]:
    """Return the change of a text like ``map.resolution=0.1``, of TOML or a bare word, or raise a `ConfigError`."""
    path, equals, value_text = text.partition("=")
    keys = [key.strip() for key in path.split(".")]
    if not equals or not all(keys):
        raise ConfigError(f"setting {text!r} must look like map.resolution=0.1")
    try:
        value: object = tomllib.loads(f"value = {value_text}")["value"]
    except (ValueError, RecursionError):  # invalid TOML, numbers of thousands of digits, very deep lists
        value = value_text
    change: dict[str, object] = {keys[-1]: value}
    for key in reversed(keys[:-1]):
        change = {key: change}
    return change


def parameter_names(config: object, above: str = "") -> Iterator[str]:
    """Yield the dotted name of every parameter and table."""
    for name, value in fields_of(config).items():
        yield above + name
        if is_table(value):
            yield from parameter_names(value, f"{above}{name}.")


def is_table(value: object) -> bool:
    """Return whether a value is a table of parameters rather than one parameter."""
    return isinstance(value, BaseModel) or (dataclasses.is_dataclass(value) and not isinstance(value, type))


def fields_of(table: object) -> dict[str, object]:
    """Return the values of a table by name."""
    if isinstance(table, BaseModel):
        return {name: getattr(table, name) for name in type(table).model_fields}
    return {field.name: getattr(table, field.name) for field in dataclasses.fields(cast("Any", table))}


def _overlaid(old: object, change: object, place: tuple[str, ...], names: Sequence[str], source: str) -> object:
    """Return a table's values under a change of some of them."""
    if not is_table(old):
        _check_kind(change, old, place, source)
        return change
    known = fields_of(old)
    if not isinstance(change, Mapping):
        here = ".".join(place)
        raise ConfigError(f"{source}: {here} is a table: name one of its parameters, as {here}.{next(iter(known))}")
    values = dict(known)
    for key, new in change.items():
        if key not in known:
            raise ConfigError(f"{source}: {_unknown(key, place, list(known), names)}")
        below = _of_kind(old, key, new)
        values[key] = _overlaid(below, new, (*place, key), names, source)
    return values


def _check_kinds(given: object, made: object, place: tuple[str, ...], source: str) -> None:
    """Refuse booleans and texts for numbers, and numbers for booleans, anywhere in a table."""
    if isinstance(given, Mapping):
        values = fields_of(made) if is_table(made) else cast("Mapping[str, object]", made)
        for key, item in given.items():
            _check_kinds(item, values[key], (*place, key), source)
    elif isinstance(given, list | tuple) and isinstance(made, list | tuple):
        for item, other in zip(given, made, strict=False):
            _check_kinds(item, other, place, source)
    else:
        _check_kind(given, made, place, source)


def _check_kind(given: object, value: object, place: tuple[str, ...], source: str) -> None:
    """Refuse a value of another kind than that of the parameter."""
    is_truth = isinstance(value, bool)
    if isinstance(value, int | float) and isinstance(given, bool | str | int | float):
        fits = isinstance(given, bool) if is_truth else not isinstance(given, bool | str)
        if not fits:
            kind = "true or false" if is_truth else "a number"
            raise ConfigError(f"{source}: {'.'.join(place)} must be {kind}, got {reprlib.repr(given)}")


def _of_kind(table: object, key: str, change: object) -> object:
    """Return a table's value at a key, or the defaults of the kind of table in a change."""
    value = fields_of(table)[key]
    field = type(table).model_fields[key] if isinstance(table, BaseModel) else None
    if field is None or not isinstance(field.discriminator, str) or not isinstance(change, Mapping):
        return value
    wanted = change.get(field.discriminator, getattr(value, field.discriminator))
    kinds = {kind.model_fields[field.discriminator].default: kind for kind in get_args(field.annotation)}
    return (
        value
        if not isinstance(wanted, str) or wanted not in kinds or isinstance(value, kinds[wanted])
        else kinds[wanted]()
    )


def _unknown(key: str, place: tuple[str, ...], siblings: Sequence[str], names: Sequence[str]) -> str:
    """Return the error of an unknown parameter, with the most similar one."""
    full = ".".join((*place, key))
    elsewhere = [name for name in names if name.rpartition(".")[2] == key]
    near = difflib.get_close_matches(key, siblings, n=1)
    last = {name.rpartition(".")[2]: name for name in reversed(names)}
    alike = [last[name] for name in difflib.get_close_matches(key, last, n=1)]
    meant = [".".join((*place, name)) for name in near] or elsewhere or alike
    if meant:
        return f"there is no parameter {full!r}: did you mean {meant[0]!r}?"
    return f"there is no parameter {full!r}: {'.'.join(place) or 'the top'} has {', '.join(siblings)}"


def _place(config: object, location: Sequence[str | int]) -> str:
    """Return the place of a validation error as a dotted name, without pydantic's names of types."""
    parts: list[str] = []
    at: object = config
    kind_follows = False
    for part in map(str, location):
        if kind_follows:
            kind_follows = False
            continue
        parts.append(part)
        known = fields_of(at) if is_table(at) else {}
        field = type(at).model_fields.get(part) if isinstance(at, BaseModel) else None
        kind_follows = field is not None and field.discriminator is not None
        at = known.get(part)
    return ".".join(parts)
