"""A report as one HTML file that needs nothing else: no server, no network, no other file."""

import base64
import hashlib
import importlib.metadata
import json
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from urllib.parse import unquote

from tbmslam.report.sheet import Sheet

_ASSETS = files("tbmslam.report") / "assets"


@dataclass(frozen=True)
class Table:
    """Rows of text.

    Parameters
    ----------
    title
        Its heading.
    heads
        Names of the columns; those that begin with # hold numbers.
    rows
        Cells, as many in each row as there are columns.
    note
        What to know about it.
    colours
        CSS colour of each row's mark; empty for none.
    """

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    colours: Sequence[str] = ()


@dataclass(frozen=True)
class Picture:
    """A picture with what is seen on it."""

    png: bytes
    caption: str

    @property
    def url(self) -> str:
        """The picture as a data URL."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode("ascii")


@dataclass(frozen=True)
class Card:
    """A question that was decided: how, why, and what to judge it by.

    Parameters
    ----------
    title
        What was asked.
    verdict
        The answer in a word.
    good
        Whether the answer is yes.
    reason
        Why, in a sentence.
    figures
        Numbers, by name.
    pictures
        To see it oneself.
    copied
        What a button copies: a pose as the programs take it; no button where empty.
    """

    title: str
    verdict: str
    good: bool
    reason: str
    figures: Mapping[str, str] = field(default_factory=dict)
    pictures: Sequence[Picture] = ()
    copied: str = ""


@dataclass(frozen=True)
class Page:
    """What a report says.

    Parameters
    ----------
    title, verdict
        What was done, and what came of it in a sentence.
    good
        Whether that is what one wants.
    figures
        The few numbers to see first, by name.
    sheets
        Maps to look at.
    warnings
        What may be wrong with the data or the result, a sentence each.
    tables
        Figures in rows.
    downloads
        Addresses of files beside the page, by whose they are.
    cards, cards_title, cards_note
        Decisions, and what they are about.
    seconds
        How long each step took [s].
    command
        What was typed.
    versions
        Of the program and what it stands on.
    config
        Every parameter; may be nested.
    defaults
        Those that are usual: others are marked as changed. Nothing is marked where empty.
    """

    title: str
    verdict: str
    good: bool = True
    figures: Mapping[str, str] = field(default_factory=dict)
    sheets: Sequence[Sheet] = ()
    warnings: Sequence[str] = ()
    tables: Sequence[Table] = ()
    downloads: Mapping[str, Sequence[str]] = field(default_factory=dict)
    cards: Sequence[Card] = ()
    cards_title: str = ""
    cards_note: str = ""
    seconds: Mapping[str, float] = field(default_factory=dict)
    command: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    config: Mapping[str, object] = field(default_factory=dict)
    defaults: Mapping[str, object] = field(default_factory=dict)

    def to_html(self) -> str:
        """Return the page; what came from outside is text in it and never markup."""
        import jinja2  # noqa: PLC0415  # only reports need it

        environment = jinja2.Environment(
            autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
        )
        scripts = [_leaflet(), _asset("page.js")]
        return environment.from_string(_asset("page.html")).render(
            page=self,
            styles=[_without_pictures(_asset("leaflet.css")), _asset("page.css")],
            scripts=scripts,
            script_hashes=" ".join(f"'sha256-{_digest(script)}'" for script in scripts),
            data=_as_script_data({"sheets": [sheet.as_json() for sheet in self.sheets]}),
            config=_marked(self.config, self.defaults),
            name_of=lambda address: unquote(address.rpartition("/")[2]),
        )


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")


def _leaflet() -> str:
    """Return the library without the hint to a source map, which a browser would ask for."""
    return re.sub(r"^//# sourceMappingURL=.*$", "", _asset("leaflet.js"), flags=re.MULTILINE)


def _without_pictures(style: str) -> str:
    """Return a style sheet without references to pictures, none of which is used here."""
    return re.sub(r"url\([^)]*\)", "none", style)


def _digest(script: str) -> str:
    """Return what the content security policy of the page knows a script by."""
    return base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")


def _as_script_data(value: object) -> str:
    """Return JSON that cannot end the script element it stands in."""
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
    """Return name, value, and the usual value where it is another, of every parameter; changed ones first."""
    usual = dict(_flat(defaults))
    marked = [(name, value, usual.get(name, value)) for name, value in _flat(config)]
    return sorted(
        ((name, value, "" if was == value else was) for name, value, was in marked), key=lambda row: not row[2]
    )


_NAMED = ("tbmslam", "numpy", "numba", "opencv-python-headless", "rosbags")


@dataclass(frozen=True)
class Making:
    """What a report says of the run that it reports.

    Parameters
    ----------
    command
        What was typed.
    seconds
        How long each step took [s].
    defaults
        Every parameter as it is usually; may be nested.
    """

    command: str = ""
    seconds: Mapping[str, float] = field(default_factory=dict)
    defaults: Mapping[str, object] = field(default_factory=dict)


def versions() -> dict[str, str]:
    """Return the versions of Python and of what results depend on, as far as it is installed."""
    found = {"python": platform.python_version()}
    for name in _NAMED:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found
