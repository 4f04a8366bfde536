"""What a measurement found, with the commit, the date and the machine."""

import argparse
import dataclasses
import json
import os
import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from tbmslam.io.atomic_file import write_text
from tbmslam.report.page import versions
from tools.command_line.text_table import ResultTable


def describe_machine() -> dict[str, object]:
    """Return processor, system and versions; `load` is the mean number of busy processes in the last minute."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        **versions(),
    }


def _processor() -> str:
    """Return the processor's name; on systems with /proc, `platform` does not know it."""
    listing = Path("/proc/cpuinfo")
    if listing.exists():
        for line in listing.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


_CODE = ("tbmslam", "merging", "datasets", "tools")  # folders whose code affects the figures
_ROOT = Path(__file__).resolve().parents[2]


def write_tables(path: Path | None, machine: Mapping[str, object], tables: Mapping[str, ResultTable]) -> None:
    """Write the tables of a benchmark with commit, date and machine to a file, if given, for `tools/figures.py`.

    Tables without rows are left out.
    """
    if path is None:
        return
    record = {
        "commit": commit_of_code(_ROOT),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": {key: value for key, value in machine.items() if key != "system"},  # may name a private kernel
        "tables": {
            name: {"columns": [*table.columns], "rows": [[*row] for row in table.rows]}
            for name, table in tables.items()
            if table.rows
        },
    }
    write_text(path, json.dumps(record, indent=1, ensure_ascii=False) + "\n")


def write_figures(path: Path | None, machine: Mapping[str, object], figures: Mapping[str, object]) -> None:
    """Write the machine and all figures of a benchmark to a file, if given."""
    if path is not None:
        record = {"machine": machine, **figures}
        write_text(path, json.dumps(record, indent=2, default=dataclasses.asdict) + "\n")


def finish(args: argparse.Namespace, tables: Mapping[str, ResultTable], figures: Mapping[str, object]) -> None:
    """Print `args.machine`, and write the tables and figures of a benchmark to the files of `--table` and `--json`."""
    print(", ".join(f"{key} {value}" for key, value in args.machine.items()))
    write_tables(args.table, args.machine, tables)
    write_figures(args.json, args.machine, figures)


def commit_of_code(root: Path) -> str | None:
    """Return the commit of a checkout, with `-changed` if its code differs; None outside a checkout."""
    try:
        commit, changes = (
            subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603, S607 - fixed words
            for words in (("rev-parse", "--short", "HEAD"), ("status", "--porcelain", "--", *_CODE))
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{commit}-changed" if changes else commit
