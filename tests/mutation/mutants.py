"""Put small faults into the code, and see which of them the nearest tests notice.

`draw` draws the mutants by a seed and writes drawn.json, which is committed before tests are written for them. `run`
plants each in a copy of the repository and runs the tests nearest to it: those of its module, then those that name it
or share its folder; slow tests and recordings outside the repository are left out. It prints each mutant's fate and the
score. equivalent.toml lists mutants that no test can notice, each with the reason; these are not run.
"""

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.mutation.mutations import Mutation, mutated, mutations  # noqa: E402
from tools.command_line.measurement_record import describe_machine, write_tables  # noqa: E402
from tools.command_line.text_table import ResultTable, text_table  # noqa: E402

HERE = ROOT / "tests" / "mutation"
SEED = 20261124
EACH_AREA = 40
# The longest that the nearest tests of a module take, kernels compiled again, is some 2 minutes; a mutant that runs
# longer than this loops for ever.
TIMEOUT = 600.0


@dataclass(frozen=True)
class Mutant:
    """A mutation of one file of an area; its name is its area and its place in the draw."""

    name: str
    path: str
    mutation: Mutation

    @property
    def area(self) -> str:
        """The area that it was drawn from."""
        return self.name.partition("-")[0]

    def __str__(self) -> str:
        change = f"{self.mutation.before!r} -> {self.mutation.after!r}"
        return f"{self.name} {self.path}:{self.mutation.line} {change}"


def draw() -> list[Mutant]:
    """Return the mutants that the seed draws from the code as it stands, the same number from each area."""
    areas: Mapping[str, list[str]] = tomllib.loads((HERE / "areas.toml").read_text())
    drawn = []
    for area, places in areas.items():
        all_of_area = [
            (path, mutation) for path in _modules(places) for mutation in mutations((ROOT / path).read_bytes())
        ]
        chosen = random.Random(f"{SEED} {area}").sample(all_of_area, EACH_AREA)  # noqa: S311 - no secret
        drawn += [Mutant(f"{area}-{index}", path, mutation) for index, (path, mutation) in enumerate(chosen)]
    return drawn


def nearest_tests(path: str) -> list[list[str]]:
    """Return the tests of a module, nearest first: its own file, then those that name it or share its folder."""
    module = Path(path)
    folder = Path("tests") / module.parent
    own = folder / f"test_{module.stem}.py"
    dotted = ".".join(module.with_suffix("").parts)
    naming = {
        test
        for test, text in _texts_of_tests().items()
        if dotted in text or f"from {'.'.join(module.parent.parts)} import {module.stem}" in text
    }
    sharing = {str(test.relative_to(ROOT)) for test in (ROOT / folder).glob("test_*.py")}
    rest = sorted((naming | sharing) - {str(own)})
    return [tests for tests in ([str(own)] if (ROOT / own).exists() else [], rest) if tests]


@cache
def _texts_of_tests() -> dict[str, str]:
    return {
        str(test.relative_to(ROOT)): test.read_text(encoding="utf-8") for test in (ROOT / "tests").rglob("test_*.py")
    }


def is_killed(mutant: Mutant, copy: Path) -> bool:
    """Return whether a near test fails in a copy of the repository with the mutant planted."""
    target = copy / mutant.path
    source = target.read_bytes()
    target.write_bytes(mutated(source, mutant.mutation))
    try:
        return any(_fail(tests, copy) for tests in nearest_tests(mutant.path))
    finally:
        target.write_bytes(source)


def _fail(tests: Sequence[str], copy: Path) -> bool:
    environment = os.environ | {"PYTHONPATH": str(copy), "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-p", "no:cacheprovider", "-m", "not slow"]
    try:
        run = subprocess.run(  # noqa: S603 - the tests of this repository
            [*command, *tests], cwd=copy, env=environment, capture_output=True, timeout=TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        return True
    return run.returncode not in (0, 5)  # 5: no test is left


def _modules(places: Sequence[str]) -> Iterator[str]:
    for place in places:
        found = sorted((ROOT / place).rglob("*.py")) if (ROOT / place).is_dir() else [ROOT / place]
        yield from (str(path.relative_to(ROOT)) for path in found if path.name != "__init__.py")


def drawn() -> list[Mutant]:
    """Return the mutants that were drawn."""
    rows = json.loads((HERE / "drawn.json").read_text())
    return [Mutant(row["name"], row["path"], Mutation(**row["mutation"])) for row in rows]


def equivalent() -> dict[str, str]:
    """Return why some mutants cannot be noticed, by their names."""
    reasons: dict[str, str] = tomllib.loads((HERE / "equivalent.toml").read_text())
    return reasons


def _copied(folder: Path) -> Path:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True)  # noqa: S607
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    return folder


def _run(mutants: Sequence[Mutant], jobs: int) -> dict[str, bool]:
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(jobs) as pool:
        free: SimpleQueue[Path] = SimpleQueue()
        for job in range(jobs):
            free.put(_copied(Path(scratch) / str(job) / "project"))

        def tried(mutant: Mutant) -> tuple[str, bool]:
            copy = free.get()
            try:
                killed = is_killed(mutant, copy)
            finally:
                free.put(copy)
            sys.stdout.write(f"{'killed  ' if killed else 'SURVIVED'} {mutant}\n")
            sys.stdout.flush()
            return mutant.name, killed

        return dict(pool.map(tried, mutants))


def scores(mutants: Sequence[Mutant], killed: Mapping[str, bool]) -> ResultTable:
    """Return how many mutants of each area were drawn, cannot be noticed, were killed and survived."""
    rows = []
    for area in (*dict.fromkeys(mutant.area for mutant in mutants), "all"):
        own = [mutant.name for mutant in mutants if area in (mutant.area, "all")]
        fates = Counter(killed.get(name) for name in own)
        tried = fates[True] + fates[False]
        share = f"{fates[True] / tried:.1%}" if tried else "-"
        rows.append([area, str(len(own)), str(fates[None]), str(fates[True]), str(fates[False]), share])
    return ResultTable(["area", "mutants", "not to be noticed", "killed", "survived", "score"], rows)


def _change_of(mutant: Mutant) -> str:
    mutation = mutant.mutation
    return f"`{mutation.before}` to `{mutation.after}` in `{mutation.text.strip()}`".replace("|", "\\|")


def parser() -> argparse.ArgumentParser:
    """Return the program's grammar."""
    grammar = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    grammar.add_argument("command", choices=["draw", "run"])
    grammar.add_argument("names", nargs="*", help="mutants or areas to run (all)")
    grammar.add_argument("--jobs", type=int, default=2, help="mutants that are tried at a time")
    grammar.add_argument("--table", type=Path, metavar="FILE", help="write the score here for docs/figures")
    return grammar


def main() -> int:
    """Run the program; return its exit code."""
    args = parser().parse_args()
    if args.command == "draw":
        rows = [asdict(mutant) for mutant in draw()]
        (HERE / "drawn.json").write_text("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n")
        return 0
    reasons = equivalent()
    wanted = [mutant for mutant in drawn() if not args.names or {mutant.name, mutant.area} & set(args.names)]
    killed = _run([mutant for mutant in wanted if mutant.name not in reasons], args.jobs)
    table = scores(wanted, killed)
    alive = [mutant for mutant in wanted if killed.get(mutant.name) is False]
    survivors = ResultTable(["survivor", "change"], [[mutant.path, _change_of(mutant)] for mutant in alive])
    sys.stdout.write(text_table(table.columns, table.rows) + "\n")
    if args.table is not None:
        write_tables(args.table, describe_machine(), {"score": table, "survivors": survivors})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
