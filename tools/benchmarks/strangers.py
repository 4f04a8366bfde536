"""The rate of false accepts among simulated pairs of maps of different places."""

import argparse
import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TypeVar

import numpy as np
from tqdm import tqdm

from datasets.synthetic.buildings import VARIETY
from datasets.synthetic.map_pairs.pairs import (
    Building,
    MapPair,
    building_of_world,
    cut_pairs,
    disjoint_pair,
    foreign_pair,
    mirrored,
    room_of,
)
from merging import align
from tbmslam.errors import TbmSlamError
from tbmslam.parallel.cluster import code_digest, packages_of
from tbmslam.parallel.executor import Call, Executor
from tbmslam.special_file import why_unreadable
from tools.command_line.measurement_record import finish, write_figures
from tools.command_line.text_table import ResultTable, number, text_table
from tools.map_pairs.known_pair import KnownPair

KINDS = {
    "unrelated": "maps of two buildings, whole or in part",
    "mirrored": "a building and its mirror image",
    "far ends": "two ends of a building that share nothing",
    "self-similar": "two parts of a corridor that looks the same everywhere; a place other than the true one counts",
}
UNKNOWN_TO_EACH_OTHER = ("unrelated", "mirrored", "far ends")
"""The kinds whose maps show different places, so that no pose is right."""
HEAD = ("pairs", "maps", "tried", "accepted wrongly", "rate %", "95 % interval", "refused as ambiguous")

_T = TypeVar("_T")
_PAIRS_A_BUILDING = 8
_SAVED_EVERY = 16
_SMALLEST_M2, _LARGEST_M2 = 40.0, 400.0


class EarlierRunError(TbmSlamError):
    """The file of an earlier run does not match this run."""


@dataclass(frozen=True)
class Encounter:
    """The alignment of one pair."""

    kind: str
    """One of `KINDS`."""
    number: int
    """Number of the pair among those of its kind and seed."""
    name: str
    is_wrong: bool
    """Whether a false alignment was accepted."""
    is_ambiguous: bool
    """Whether it was refused because several poses fit well."""
    confidence: float


def benchmark_strangers(args: argparse.Namespace) -> None:
    """Align pairs and print the rates; pairs in the file of `--json` are not tried again."""
    what: dict[str, object] = {"seed": args.seed, "judge": _judge()}
    done = _tried_before(args.json, what)
    kinds = list(KINDS)
    tasks = [(kinds[index % len(KINDS)], index // len(KINDS), args.seed) for index in range(args.pairs)]
    left = [task for task in tasks if task[:2] not in done]
    # Neighbouring tasks share a building, so a worker gets many of them at a time.
    encountered = meetings(meet, left, Executor(args.workers), len(KINDS) * _PAIRS_A_BUILDING)
    for met, encounter in enumerate(tqdm(encountered, total=len(left), disable=None), start=1):
        done[encounter.kind, encounter.number] = encounter
        if met % _SAVED_EVERY == 0:
            write_figures(args.json, args.machine, what | {"encounters": [*done.values()]})
    encounters = sorted((done[task[:2]] for task in tasks), key=lambda encounter: (encounter.kind, encounter.number))
    rows = [
        _row(kind, about, [encounter for encounter in encounters if encounter.kind == kind])
        for kind, about in KINDS.items()
    ]
    rows.append(_row("all", "", encounters))
    print(text_table(HEAD, rows))
    for encounter in encounters:
        if encounter.is_wrong:
            print(f"wrongly accepted: {encounter.name}, confidence {encounter.confidence:.3f}")
    finish(args, {"pairs": ResultTable(HEAD, rows)}, what | {"encounters": [*done.values()]})


def meet(kind: str, number_of_pair: int, seed: int) -> Encounter:
    """Make a pair by its numbers and align it."""
    pair = make_pair(kind, number_of_pair, seed)
    found = align(pair.target, pair.source)
    is_wrong = found.accepted and not pair.is_right(found.T_target_source)
    return Encounter(kind, number_of_pair, f"{pair.name}_{number_of_pair}", is_wrong, found.ambiguous, found.confidence)


def make_pair(kind: str, number_of_pair: int, seed: int) -> KnownPair:
    """Make a pair of maps by its numbers."""
    return KnownPair.of(_pair(kind, number_of_pair, seed))


def pair_of_two_places(number: int, seed: int) -> KnownPair:
    """Make a pair of maps of different places by its number; the kinds take turns."""
    turn, kind = divmod(number, len(UNKNOWN_TO_EACH_OTHER))
    return make_pair(UNKNOWN_TO_EACH_OTHER[kind], turn, seed)


def _judge() -> str:
    """Return an identifier of the code and the models; results of different ones are never mixed."""
    models = [
        resources.files("merging").joinpath(f"{name}_model.json").read_text(encoding="utf-8")
        for name in ("confidence", "deformed")
    ]
    code = code_digest(*packages_of(align), __package__)
    return hashlib.sha256("".join([*models, code]).encode()).hexdigest()[:16]


def _tried_before(path: Path | None, what: dict[str, object]) -> dict[tuple[str, int], Encounter]:
    """Return the encounters of an earlier run, by kind and number."""
    if path is None or not path.exists():
        return {}
    if why := why_unreadable(path):
        raise EarlierRunError(f"{path}: {why}: name another file or remove it")
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        found = [Encounter(**encounter) for encounter in record["encounters"]]
        same = all(record[key] == value for key, value in what.items())
    except (OSError, ValueError, TypeError, KeyError):
        same = False
    if not same:
        raise EarlierRunError(f"{path}: is no earlier run with this seed and this code: name another file or remove it")
    return {(encounter.kind, encounter.number): encounter for encounter in found}


def meetings(
    meeting: Callable[..., _T], tasks: Sequence[tuple[object, ...]], executor: Executor, chunksize: int
) -> Iterator[_T]:
    """Yield the result of a meeting for each task, in this process or in several; a process gets chunks of tasks."""
    size = 1 if executor.is_serial(len(tasks)) else chunksize
    chunks = [tasks[first : first + size] for first in range(0, len(tasks), size)]
    calls = [Call(f"{index}", _all_of, (meeting, chunk)) for index, chunk in enumerate(chunks)]
    for outcome in executor.outcomes(calls):
        if isinstance(outcome, TbmSlamError):
            raise outcome
        yield from outcome


def _all_of(meeting: Callable[..., _T], tasks: Sequence[tuple[object, ...]]) -> list[_T]:
    return [meeting(*task) for task in tasks]


def _pair(kind: str, index: int, seed: int) -> MapPair:
    rng = np.random.default_rng([seed, index, list(KINDS).index(kind)])
    draw = int(rng.integers(2**31))
    family = seed * 10_000 + index // _PAIRS_A_BUILDING
    if kind == "self-similar":
        overlap = float(rng.choice([0.25, 0.5, 0.75]))
        return next(cut_pairs(_building("corridor", family), draw, [overlap]))
    if kind == "far ends":
        return disjoint_pair(_building(VARIETY[index % len(VARIETY)], family), draw)
    first = some_part(_building(VARIETY[index % len(VARIETY)], family), rng)
    if kind == "mirrored":
        return foreign_pair(first, mirrored(first), draw)
    other = VARIETY[int(rng.integers(len(VARIETY)))]
    return foreign_pair(first, some_part(_building(other, family + 5_000), rng), draw)


def building_of(number: int, rng: np.random.Generator) -> Building:
    """Return a building of any kind."""
    return _building(VARIETY[int(rng.integers(len(VARIETY)))], number)


def some_part(building: Building, rng: np.random.Generator) -> Building:
    """Return a whole building, or with a probability of one half the surroundings of one place."""
    if rng.random() < 0.5:
        return building
    return room_of(building, float(rng.uniform(_SMALLEST_M2, _LARGEST_M2)), int(rng.integers(2**31)))


@lru_cache(maxsize=32)
def _building(world: str, seed: int) -> Building:
    return building_of_world(world, seed)


def _row(kind: str, about: str, encounters: list[Encounter]) -> list[str]:
    tried, wrong = len(encounters), sum(encounter.is_wrong for encounter in encounters)
    if not tried:
        return [kind, about, "0", "0", "-", "-", "0"]
    ambiguous = sum(encounter.is_ambiguous for encounter in encounters)
    return [kind, about, str(tried), str(wrong), *rate_of(wrong, tried), str(ambiguous)]


def rate_of(wrong: int, tried: int) -> tuple[str, str]:
    """Return the rate of errors and its 95 % interval (Clopper and Pearson 1934) [%]."""
    from scipy.stats import binomtest  # takes half a second, in each process

    interval = binomtest(wrong, tried).proportion_ci(0.95)
    return number(100.0 * wrong / tried, 2), f"{100.0 * interval.low:.2f} to {100.0 * interval.high:.2f}"
