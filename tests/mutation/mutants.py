"""Put small faults into the code, and see which of them the nearest tests notice.

`draw` draws the mutants by a seed and writes drawn.json, which is committed before tests are written for them. `run`
plants each in a copy of the repository and runs the tests nearest to it: those of its module, then those that name it
or share its folder; slow tests and recordings outside the repository are left out. It prints the survivors and writes
docs/figures/mutants.json. equivalent.toml lists mutants that no test can notice, each with the reason.
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
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.mutation.mutations import Mutation, mutated, mutations  # noqa: E402

HERE = ROOT / "tests" / "mutation"
SEED = 20261124
EACH_AREA = 40
# The longest that the nearest tests of a module take, kernels compiled anew, is some 2 minutes; a mutant that runs
# longer than this loops for ever.
TIMEOUT = 600.0


@dataclass(frozen=True)
class Mutant:
    """A mutation of one file of an area; its name is its area and its place in the draw."""

    name: str
    path: str
    mutation: Mutation

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
        chosen = random.Random(f"{SEED} {area}").sample(all_of_area, EACH_AREA)
        drawn += [Mutant(f"{area}-{index}", path, mutation) for index, (path, mutation) in enumerate(chosen)]
    return drawn


def nearest_tests(path: str) -> list[list[str]]:
    """Return the tests of a module, nearest first: its own file, then those that name it or share its folder."""
    module = Path(path)
    folder = Path("tests") / module.parent
    own = folder / f"test_{module.stem}.py"
    dotted = ".".join(module.with_suffix("").parts)
    naming = {
        str(test.relative_to(ROOT))
        for test in (ROOT / "tests").rglob("test_*.py")
        if dotted in (text := test.read_text(encoding="utf-8"))
        or f"from {'.'.join(module.parent.parts)} import {module.stem}" in text
    }
    sharing = {str(test.relative_to(ROOT)) for test in (ROOT / folder).glob("test_*.py")}
    rest = sorted((naming | sharing) - {str(own)})
    return [tests for tests in ([str(own)] if (ROOT / own).exists() else [], rest) if tests]


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
        run = subprocess.run([*command, *tests], cwd=copy, env=environment, capture_output=True, timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        return True
    return run.returncode not in (0, 5)  # 5: no test is left


def _modules(places: Sequence[str]) -> Iterator[str]:
    for place in places:
        found = sorted((ROOT / place).rglob("*.py")) if (ROOT / place).is_dir() else [ROOT / place]
        yield from (str(path.relative_to(ROOT)) for path in found if path.name != "__init__.py")


def _read(path: Path) -> list[Mutant]:
    rows = json.loads(path.read_text())
    return [Mutant(row["name"], row["path"], Mutation(**row["mutation"])) for row in rows]


def _copied(folder: Path) -> Path:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True)
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
            print(f"{'killed  ' if killed else 'SURVIVED'} {mutant}", flush=True)
            return mutant.name, killed

        return dict(pool.map(tried, mutants))


def main() -> int:
    """Run the program; return its exit code."""
    grammar = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    grammar.add_argument("command", choices=["draw", "run"])
    grammar.add_argument("names", nargs="*", help="mutants or areas to run (all)")
    grammar.add_argument("--jobs", type=int, default=2)
    args = grammar.parse_args()
    if args.command == "draw":
        rows = [asdict(mutant) for mutant in draw()]
        (HERE / "drawn.json").write_text("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n")
        return 0
    wanted = [
        mutant
        for mutant in _read(HERE / "drawn.json")
        if not args.names or {mutant.name, mutant.name.partition("-")[0]} & set(args.names)
    ]
    killed = _run(wanted, args.jobs)
    print(f"{sum(killed.values())} of {len(killed)} killed")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
