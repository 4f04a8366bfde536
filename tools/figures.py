"""Measure the figures of README and docs, and fill the pages from the files that hold them.

docs/figures holds a JSON file for each benchmark: the commands that measure it, and their tables with commit, date and
machine. A page shows a table between `<!-- table: FILE/TABLE | COLUMN | ... -->` and `<!-- /table -->` (all
columns where none is named), and one cell between `<!-- figure: FILE/TABLE/ROW/COLUMN -->` and `<!-- /figure -->`,
where ROW is the first cell of its row.
"""

import argparse
import json
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tbmslam.errors import TbmSlamError
from tbmslam.io.atomic_file import write_text
from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, run_program

ROOT = Path(__file__).resolve().parents[1]

EXAMPLES = """examples:
  python tools/figures.py fill
      write the tables of docs/figures into README and docs
  python tools/figures.py measure slam split --data ../shared/data
      measure two of them again, then fill the pages
  python tools/figures.py list
      names, commands and commits of all figures
"""

_TABLE = re.compile(r"(<!-- table: ([^>]+?) -->\n)(.*?)(<!-- /table -->)", re.DOTALL)
_FIGURE = re.compile(r"(<!-- figure: ([^>]+?) -->)(.*?)(<!-- /figure -->)", re.DOTALL)
_MARKER = re.compile(r"<!-- /?(?:table|figure)\b")
_NUMERIC = re.compile(r"[-+−]?\d[\d.,/ %]*(?:(?:of|to) \d[\d.,]*)?|-|")

Record = Mapping[str, Any]


class FigureError(TbmSlamError):
    """A page names an unknown figure, or a figure cannot be measured."""


def parser() -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog="figures", description=__doc__, epilog=EXAMPLES)
    commands = grammar.add_subparsers(dest="command", required=True, metavar="fill|measure|list")
    commands.add_parser("fill", help="write the figures into README and docs")
    measure = commands.add_parser("measure", help="run benchmarks, then fill")
    measure.add_argument("names", nargs="*", metavar="NAME", help="figures, as `list` names them (all)")
    measure.add_argument(
        "--data", type=path_argument, metavar="DIR", default=Path("../shared/data"), help="where the recordings are"
    )
    commands.add_parser("list", help="print names, commands and commits")
    return grammar


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; return its exit code."""
    args = parser().parse_args(argv)
    return run_program("figures", lambda: _run(args))


def _run(args: argparse.Namespace) -> None:
    records = read_records(ROOT / "docs" / "figures")
    if args.command == "list":
        for name, record in records.items():
            print(f"{name} ({record['commit']}, {record['date']})")
            for command in record["commands"]:
                print(f"    {command}")
        return
    if args.command == "measure":
        for name in _wanted(args.names, records):
            _measure(name, records[name], args.data)
        records = read_records(ROOT / "docs" / "figures")
    for page in pages(ROOT):
        text = page.read_text(encoding="utf-8")
        if (filled := fill(text, records, page.name)) != text:
            write_text(page, filled)
            sys.stderr.write(f"figures: {page.relative_to(ROOT)} filled\n")


def pages(root: Path) -> list[Path]:
    """Return README and the pages of docs."""
    return [root / "README.md", *sorted((root / "docs").glob("*.md"))]


def read_records(folder: Path) -> dict[str, Record]:
    """Return the contents of the files of a folder by their names without suffix."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))}


def fill(text: str, records: Mapping[str, Record], page: str) -> str:
    """Return the text of a page with all its figures as the records have them."""
    found = 2 * (len(_TABLE.findall(text)) + len(_FIGURE.findall(text)))
    if found != len(_MARKER.findall(text)):
        raise FigureError(f"{page}: a marker of a table or figure has no end, or no begin: correct it")
    text = _TABLE.sub(_filling(lambda words: table_text(words, records), page), text)
    return _FIGURE.sub(_filling(lambda words: figure_text(words, records), page), text)


def table_text(words: str, records: Mapping[str, Record]) -> str:
    """Return the table that `FILE/TABLE | COLUMN | ...` names, as Markdown, and the commit that it was measured at.

    Columns of numbers are right-aligned.
    """
    place, *names = (word.strip() for word in words.split("|"))
    table = _table(place, records)
    chosen = [_index(name, table["columns"], f"{place} has no column") for name in names or table["columns"]]
    head, *rows = ([row[index] for index in chosen] for row in (table["columns"], *table["rows"]))
    is_numeric = [all(_NUMERIC.fullmatch(cell) for cell in column) for column in zip(*rows, strict=True)]
    rule = "|".join("--:" if right else "---" for right in is_numeric)
    lines = [f"| {' | '.join(line)} |" for line in (head, *rows)]
    commit = records[place.partition("/")[0]]["commit"]
    return "\n".join([lines[0], f"|{rule}|", *lines[1:], "", f"<sub>Measured at {commit}.</sub>", ""])


def figure_text(words: str, records: Mapping[str, Record]) -> str:
    """Return the cell that `FILE/TABLE/ROW/COLUMN` names."""
    try:
        file, name, row, column = words.split("/", 3)
    except ValueError:
        raise FigureError(f"a figure is FILE/TABLE/ROW/COLUMN, not {words}") from None
    table = _table(f"{file}/{name}", records)
    cells = table["rows"][_index(row, [cells[0] for cells in table["rows"]], f"{file}/{name} has no row")]
    return str(cells[_index(column, table["columns"], f"{file}/{name} has no column")])


def _filling(make: Callable[[str], str], page: str) -> Callable[[re.Match[str]], str]:
    def replaced(match: re.Match[str]) -> str:
        try:
            return match[1] + make(match[2]) + match[4]
        except FigureError as error:
            raise FigureError(f"{page}: {error}") from None

    return replaced


def _table(place: str, records: Mapping[str, Record]) -> Mapping[str, Any]:
    file, _, name = place.partition("/")
    if file not in records or name not in records[file]["tables"]:
        raise FigureError(f"docs/figures has no table {place}: correct the marker")
    table: Mapping[str, Any] = records[file]["tables"][name]
    return table


def _index(name: str, names: Sequence[str], otherwise: str) -> int:
    if name not in names:
        raise FigureError(f"{otherwise} {name!r}; there are {', '.join(names)}")
    return [*names].index(name)


def _wanted(names: Sequence[str], records: Mapping[str, Record]) -> Sequence[str]:
    for name in names:
        _index(name, [*records], "there is no figure")
    return names or [*records]


def _measure(name: str, record: Record, data: Path) -> None:
    """Run the commands of a figure and keep the tables; skip a figure whose recordings are missing."""
    words = [shlex.split(command) for command in record["commands"]]
    if not words:
        sys.stderr.write(f"figures: {name} skipped: no command measures it\n")
        return
    places = [
        Path(word.split(",")[0].replace("$DATA", str(data))) for line in words for word in line if "$DATA" in word
    ]
    if missing := [place for place in places if not place.exists()]:
        sys.stderr.write(f"figures: {name} skipped: {missing[0]} is absent, see --data\n")
        return
    with tempfile.TemporaryDirectory(prefix="figures.") as out:
        tables = Path(out) / "tables.json"
        words[-1] += ["--table", str(tables)]
        for line in words:
            sys.stderr.write(f"figures: {name}: {shlex.join(line)}\n")
            command = [word.replace("$DATA", str(data.absolute())).replace("$OUT", out) for word in line[1:]]
            command[0] = str(ROOT / command[0])
            if subprocess.run([sys.executable, *command], check=False).returncode != 0:  # noqa: S603 - our own programs
                raise FigureError(f"{name}: {line[1]} failed; the figure stays as it was")
        measured = json.loads(tables.read_text(encoding="utf-8"))
    write_record(ROOT / "docs" / "figures" / f"{name}.json", {"commands": record["commands"], **measured})


def write_record(path: Path, record: Record) -> None:
    """Write a file of figures, with one line for each row of a table."""
    text = json.dumps(record, indent=1, ensure_ascii=False) + "\n"
    write_text(path, re.sub(r"\n {5,}", " ", text).replace("\n    ]", "]"))


if __name__ == "__main__":
    sys.exit(main())
