"""The tables of a benchmark as a file: what was measured, at which commit, when and on which machine."""

import json
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from tbmslam.io.atomic_file import write_text

_CODE = ("tbmslam", "merging", "datasets", "tools")
"""Folders whose changes change figures."""
_ROOT = Path(__file__).resolve().parents[2]


class ResultTable(NamedTuple):
    """Names of columns, and rows of as many cells, as they are printed."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def write_tables(path: Path | None, machine: Mapping[str, object], tables: Mapping[str, ResultTable]) -> None:
    """Write the tables of a benchmark, by their names, with commit, date and machine; `tools/figures.py` reads them.

    Parameters
    ----------
    path
        The file; None writes nothing.
    machine
        See `tools.command_line.text_table.describe_machine`.
    tables
        Tables by name; those without rows are left out.
    """
    if path is None:
        return
    record = {
        "commit": commit_of_code(_ROOT),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": {key: value for key, value in machine.items() if key != "system"},  # a private kernel, at times
        "tables": {
            name: {"columns": [*table.columns], "rows": [[*row] for row in table.rows]}
            for name, table in tables.items()
            if table.rows
        },
    }
    write_text(path, json.dumps(record, indent=1, ensure_ascii=False) + "\n")


def commit_of_code(root: Path) -> str | None:
    """Return the commit of a checkout, with `-changed` where its code differs from that; None outside a checkout."""
    try:
        commit, changes = (
            subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603, S607 - fixed words
            for words in (("rev-parse", "--short", "HEAD"), ("status", "--porcelain", "--", *_CODE))
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{commit}-changed" if changes else commit
