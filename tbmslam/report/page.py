"""A report as one HTML file: no server, no network, and links to the files beside it."""

import base64
import hashlib
import importlib.metadata
import json
import os
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, unquote

from tbmslam.report.sheet import Sheet

if TYPE_CHECKING:
    import jinja2

_ASSETS = files("tbmslam.report") / "assets"


@dataclass(frozen=True)
class Table:
    """A table of text."""

    title: str
    heads: Sequence[str]
    """Names of the columns. Columns of numbers begin with #."""
    rows: Sequence[Sequence[str]]
    note: str = ""
    colours: Sequence[str] = ()
    """CSS colour of each row's mark; empty for none."""


@dataclass(frozen=True)
class Picture:
    """A picture with a caption."""

    png: bytes
    caption: str

    @property
    def url(self) -> str:
        """The picture as a data URL."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode("ascii")


@dataclass(frozen=True)
class Card:
    """A decision with its reason and the evidence."""

    title: str
    """The question."""
    verdict: str
    """The decision in a word."""
    good: bool
    """Whether the decision is positive."""
    reason: str
    figures: Mapping[str, str] = field(default_factory=dict)
    pictures: Sequence[Picture] = ()
    copied: str = ""
    """The text that a button copies, such as a pose; no button if empty."""


@dataclass(frozen=True)
class Page:
    """The content of a report."""

    title: str
    verdict: str
    """The task, and its result in one sentence."""
    good: bool = True
    """Whether the task succeeded."""
    figures: Mapping[str, str] = field(default_factory=dict)
    """The most important numbers, by name."""
    sheets: Sequence[Sheet] = ()
    warnings: Sequence[str] = ()
    """Possible problems of the data or the result, one sentence each."""
    tables: Sequence[Table] = ()
    downloads: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Addresses of files beside the page, by the name of the robot."""
    cards: Sequence[Card] = ()
    cards_title: str = ""
    cards_note: str = ""
    """Decisions, with a heading and a remark."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Duration of each step [s]."""
    command: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    config: Mapping[str, object] = field(default_factory=dict)
    defaults: Mapping[str, object] = field(default_factory=dict)
    """The default parameters. Parameters with other values are marked; none are marked if this is empty."""

    def to_html(self) -> str:
        """Return the page; text from files is escaped."""
        # Leaflet without its reference to a source map, which a browser would request.
        leaflet = re.sub(r"^//# sourceMappingURL=.*$", "", _asset("leaflet.js"), flags=re.MULTILINE)
        scripts = [leaflet, _asset("grid.js"), _asset("page.js")]
        return render(
            _asset("page.html"),
            page=self,
            styles=[re.sub(r"url\([^)]*\)", "none", _asset("leaflet.css")), _asset("page.css")],  # uses no pictures
            scripts=scripts,
            script_hashes=" ".join(f"'sha256-{_digest(script)}'" for script in scripts),
            data=_as_script_data({"sheets": [sheet.as_json() for sheet in self.sheets]}),
            config=_marked(self.config, self.defaults),
            name_of=lambda address: unquote(address.rpartition("/")[2]),
        )


def render(template: str, **values: object) -> str:
    """Return the page of a Jinja template; all values are escaped."""
    return _compiled(template).render(values)


@cache
def _compiled(template: str) -> "jinja2.Template":
    import jinja2  # noqa: PLC0415  # only reports need it

    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.from_string(template)


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")


def _digest(script: str) -> str:
    """Return the hash of a script for the content security policy."""
    return base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")


def _as_script_data(value: object) -> str:
    """Return JSON that cannot close the script element around it."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _flat(config: Mapping[str, object], before: str = "") -> list[tuple[str, str]]:
    """Return nested parameters as `a.b` and their values in JSON."""
    lines: list[tuple[str, str]] = []
    for name, value in config.items():
        if isinstance(value, Mapping):
            lines += _flat(value, f"{before}{name}.")
        else:
            lines.append((f"{before}{name}", json.dumps(value)))
    return lines


def _marked(config: Mapping[str, object], defaults: Mapping[str, object]) -> list[tuple[str, str, str]]:
    """Return name, value and, if it differs, the default value of every parameter; changed parameters first."""
    default = dict(_flat(defaults))
    rows = [(name, value, default.get(name, value)) for name, value in _flat(config)]
    return sorted(((name, value, "" if was == value else was) for name, value, was in rows), key=lambda row: not row[2])


_NAMED = ("tbmslam", "numpy", "scipy", "numba", "opencv-python-headless", "rosbags")


@dataclass(frozen=True)
class RunInfo:
    """The run of a program, for its report."""

    command: str = ""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Duration of each step [s]."""
    defaults: Mapping[str, object] = field(default_factory=dict)
    """The default parameters; may be nested."""


def versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that results depend on."""
    installed = {name: version for name in _NAMED if (version := _version_of(name)) is not None}
    return {"python": platform.python_version(), **installed}


def _version_of(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


_WANTED = (
    "map.yaml",
    "map.pgm",
    "map.npz",
    "map.tif",
    "map.bag",
    "map.mcap",
    "trajectory*.tum",
    "pignistic.png",
    "run.json",
    "report.json",
    "config.toml",
)
"""Patterns of file names in the order of the links."""


def downloads(page: Path, folder: Path) -> Sequence[str]:
    """Return the addresses of the files of a map, relative to the folder of a page, which contains the map's folder."""
    found = [path for pattern in _WANTED for path in sorted(folder.glob(pattern)) if path.is_file()]
    return [quote(os.fsencode(path.relative_to(page).as_posix())) for path in found]
