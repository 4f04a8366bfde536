"""A configuration as TOML: each parameter with its meaning, unit and limits."""

import inspect
import textwrap
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Literal, get_args, get_origin, get_type_hints

import tomlkit
from annotated_types import Ge, Gt, Interval, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from tomlkit.items import Table

from tbmslam.configuration.parameters import fields_of, is_table
from tbmslam.frozen_config import FrozenConfig

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
