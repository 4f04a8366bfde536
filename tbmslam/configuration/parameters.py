"""Parameters of nested configurations: their dotted names and their changes."""

import dataclasses
import difflib
import inspect
import reprlib
import textwrap
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

import tomlkit
from annotated_types import Ge, Gt, Interval, Le, Lt
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from tomlkit.items import Table

from tbmslam.errors import TbmSlamError
from tbmslam.frozen_config import FrozenConfig

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


_WIDTH = 100


def config_text(
    config: object, heading: str = "", leave_out: Collection[str] = (), reference: object | None = None
) -> str:
    """Return a configuration as TOML with a comment for each parameter, under a heading.

    A parameter without a value becomes a comment, since TOML has no null. Tables and parameters in `leave_out` are left
    out, and so are constants (see `FrozenConfig.PUBLIC`) with the value of the `reference`.
    """
    document = tomlkit.document()
    for line in textwrap.wrap(heading, _WIDTH):
        document.add(tomlkit.comment(line))
    if heading:
        document.add(tomlkit.nl())
    _fill(document, config, reference, leave_out)
    return tomlkit.dumps(document)


def descriptions_of(table: object) -> dict[str, str]:
    """Return the description of each field of a table, empty if it has none."""
    if isinstance(table, BaseModel):
        return {name: field.description or "" for name, field in type(table).model_fields.items()}
    hints = get_type_hints(type(table), include_extras=True)
    return {name: next(iter(getattr(hint, "__metadata__", ())), "") for name, hint in hints.items()}


def _fill(
    container: tomlkit.TOMLDocument | Table, table: object, reference: object | None, leave_out: Collection[str] = ()
) -> None:
    """Write a table's parameters, then the tables in it."""
    described = descriptions_of(table)
    values = {name: value for name, value in _shown(table, reference).items() if name not in leave_out}
    limits = _limits(table)
    for name, value in values.items():
        if is_table(value):
            continue
        _comment(container, described[name])
        if value is None:
            container.add(tomlkit.comment(f"{name} is not set"))
            continue
        item = tomlkit.item(_plain(value))
        if limits.get(name):
            item.comment(limits[name])
        container.add(name, item)
    for name, value in values.items():
        if is_table(value):
            below = tomlkit.table()
            summary = inspect.getdoc(type(value)) or ""
            _comment(below, described[name] or summary.partition("\n")[0])
            _fill(below, value, _counterpart(reference, name, value))
            container.add(tomlkit.nl())
            container.add(name, below)


def _shown(table: object, reference: object | None) -> dict[str, object]:
    """Return the shown values of a table: public ones, changed ones, and tables with such values."""
    values = fields_of(table)
    if reference is None or not isinstance(table, FrozenConfig):
        return values
    return {
        name: value
        for name, value in values.items()
        if name in table.PUBLIC
        or (
            _shown(value, _counterpart(reference, name, value))
            if is_table(value)
            else value != fields_of(reference)[name]
        )
    }


def _counterpart(reference: object | None, name: str, value: object) -> object | None:
    """Return the reference's table of a name, or the defaults of the table's kind if the kinds differ."""
    if reference is None:
        return None
    below = fields_of(reference)[name]
    return below if type(below) is type(value) else type(value)()


def _comment(container: tomlkit.TOMLDocument | Table, text: str) -> None:
    for line in textwrap.wrap(text, _WIDTH, break_on_hyphens=False):
        container.add(tomlkit.comment(line))


def _plain(value: object) -> object:
    """Return a value for TOML: tuples and poses are arrays."""
    if isinstance(value, Mapping):
        table = tomlkit.inline_table()
        table.update(value)
        return table
    return [_plain(item) for item in value] if isinstance(value, Sequence) and not isinstance(value, str) else value


def _limits(table: object) -> dict[str, str]:
    """Return the limits of each field beyond its type."""
    if isinstance(table, BaseModel):
        return {name: ", ".join(_limits_of(field)) for name, field in type(table).model_fields.items()}
    return {name: ", ".join(_choices(hint)) for name, hint in get_type_hints(type(table)).items()}


def _limits_of(field: FieldInfo) -> Iterator[str]:
    yield from _choices(field.annotation)
    for limit in field.metadata:
        for sign, kind, name in ((">", Gt, "gt"), (">=", Ge, "ge"), ("<", Lt, "lt"), ("<=", Le, "le")):
            if isinstance(limit, kind | Interval) and (bound := getattr(limit, name)) is not None:
                yield f"{sign} {bound:g}"


def _choices(annotation: Any) -> Iterator[str]:
    if get_origin(annotation) is Literal and len(get_args(annotation)) > 1:
        yield "one of " + ", ".join(get_args(annotation))
