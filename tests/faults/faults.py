"""Try faults on the real programs and print what became of each: what happened, and what was lost.

A row is red where the result is wrong, or where a program ended otherwise than with one clear line.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.faults import bags, hostile_maps, sensors, writing
from tests.faults.fault_case import FaultCase, Outcome
from tools.command_line.measurement_record import describe_machine, write_tables
from tools.command_line.paths import path_argument
from tools.command_line.program import ProgramParser, run_program
from tools.command_line.text_table import ResultTable, text_table

EXAMPLES = """examples:
  python tests/faults/%(prog)s.py
      try everything, some minutes
  python tests/faults/%(prog)s.py --short --family bags
      only the quickest of the damaged bags

exit codes: 0 no row is red, 1 some are, 2 wrong usage, 130 interrupted, 143 terminated
"""

FAMILIES = {"bags": bags.CASES, "sensors": sensors.CASES, "files": (*writing.CASES, *hostile_maps.CASES)}


def parser() -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog="faults", description=__doc__, epilog=EXAMPLES)
    grammar.add_argument("--short", action="store_true", help="only some of each family, less than two minutes")
    grammar.add_argument("--family", choices=FAMILIES, action="append", help="only this one; may be repeated")
    grammar.add_argument("--only", metavar="TEXT", default="", help="only faults whose name contains this")
    grammar.add_argument(
        "--table", type=path_argument, metavar="FILE", help="write the table here for docs/figures, see figures.py"
    )
    return grammar


def main(argv: list[str] | None = None) -> int:
    """Run the program; return its exit code."""
    args = parser().parse_args(argv)
    return run_program("faults", lambda: _try_all(args))


def _try_all(args: argparse.Namespace) -> int:
    rows, red = [], 0
    for family in args.family or FAMILIES:
        for case in FAMILIES[family]:
            if (args.short and not case.quick) or args.only not in case.name:
                continue
            outcome, seconds = _tried(case)
            red += not outcome.survived
            sys.stderr.write(f"{'ok ' if outcome.survived else 'RED'} {seconds:5.1f} s  {case.name}\n")
            rows.append((case.name, outcome.happened, outcome.lost, "ok" if outcome.survived else "RED"))
    head = ("fault", "what happened", "what was lost", "row")
    print(text_table(head, rows))
    write_tables(args.table, describe_machine(), {"faults": ResultTable(head[:-1], [row[:-1] for row in rows])})
    print(f"\n{len(rows)} faults tried, {red} rows red")
    return 1 if red else 0


def _tried(case: FaultCase) -> tuple[Outcome, float]:
    """Try a fault in a folder of its own."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="faults.") as folder:
        try:
            outcome = case.attempt(Path(folder))
        except Exception as error:  # noqa: BLE001 - a fault that breaks its own trial is a red row, not the end
            outcome = Outcome(f"{type(error).__name__}: {error}"[:110], "?", survived=False)
    return outcome, time.perf_counter() - began


if __name__ == "__main__":
    sys.exit(main())
