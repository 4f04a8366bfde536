"""Damaged bags: everything readable is used, and what was lost is said; or one clear line."""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

from datasets.salvage.salvaged_bag import UNTOLD
from tools.fault_cases import bag_damage
from tools.fault_cases.fault_case import FaultCase, Outcome, shortened
from tools.fault_cases.program_run import mapped, simulated

_ROS1, _BZ2 = (), ("--compression", "bz2")
_MCAP = ("--format", "mcap")


def _tried(
    folder: Path, kind: tuple[str, ...], damage: Callable[[Path], None], least: float, *, as_database: bool = False
) -> Outcome:
    """Damage a bag and map it: at least a share of its scans must be used, and those lost be said."""
    bag = simulated(folder / "drive", *kind)
    scans = len((folder / "drive" / "robot_0.truth.tum").read_text(encoding="utf-8").splitlines())
    if as_database:
        bag_damage.as_database(bag, folder / "robot_0.db3")
        bag = folder / "robot_0.db3"
    damage(next(bag.glob("*.mcap")) if bag.is_dir() else bag)
    if kind == _MCAP and bag.is_dir() and least < 1.0:
        (bag / "metadata.yaml").unlink(missing_ok=True)
    done, run = mapped(bag, folder / "maps")
    if done.code or not run:
        return Outcome(f"exit {done.code}: {done.stderr.strip()[-100:]}", "everything", survived=False)
    counts = run["counts"]
    used, lost = counts["scans_used"], counts["lost_scans"]
    told = UNTOLD if UNTOLD in done.stderr else ""
    said = told or _first(r"(the bag |the index|the database|no metadata)[^;(]*", done.stderr)
    happened = f"{used} of {scans} scans used" + (f"; {said}" if said else "")
    gone = [f"about {lost} scans, {counts['lost_seconds']:.1f} s"] if lost else []
    gone += [f"{number} {reason.replace('_', ' ')}" for reason, number in counts["dropped"].items()]
    if not gone and used < scans:
        gone = [f"{scans - used} scans"]
    right = used >= least * scans and (bool(lost or told) or used + sum(counts["dropped"].values()) == scans)
    return Outcome(happened, ", ".join(gone) or "nothing", survived=right)


def _first(pattern: str, text: str) -> str:
    found = re.search(pattern, text)
    return found[0].strip() if found else ""


def _refused(folder: Path, damage: Callable[[Path], None]) -> Outcome:
    """Map what cannot be mapped: one line must say why."""
    bag = simulated(folder / "drive", *_MCAP)
    bag_damage.as_database(bag, folder / "robot_0.db3")
    damage(folder / "robot_0.db3")
    done, _ = mapped(folder / "robot_0.db3", folder / "maps")
    line = done.stderr.strip().splitlines()[-1] if done.stderr.strip() else ""
    return Outcome(
        f"refused in one line: {shortened(line.replace(f'{folder}/', ''))}", "everything", survived=done.is_one_line()
    )


def _without_metadata(storage: Path) -> None:
    """Remove the metadata beside a storage file."""
    (storage.parent / "metadata.yaml").unlink()


def _with_broken_metadata(storage: Path) -> None:
    """Spoil the metadata beside a storage file."""
    (storage.parent / "metadata.yaml").write_text("rosbag2_bagfile_information: [", encoding="utf-8")


def _case(
    name: str,
    kind: tuple[str, ...],
    damage: Callable[[Path], None],
    least: float,
    *,
    quick: bool = False,
    as_database: bool = False,
) -> FaultCase:
    attempt = partial(_tried, kind=kind, damage=damage, least=least, as_database=as_database)
    return FaultCase(name, attempt, quick)


_half = partial(bag_damage.cut, share=0.5)

CASES = (
    _case("ROS 1 bag cut in half", _ROS1, _half, 0.48, quick=True),
    _case("ROS 1 bag of 3 min cut in half, bz2", (*_BZ2, "--duration", "180"), _half, 0.44),
    _case("ROS 1 bag without its last byte", _ROS1, bag_damage.drop_last_byte, 1.0),
    _case("ROS 1 bag of a killed recorder, no index", _BZ2, bag_damage.forget_index, 1.0, quick=True),
    _case("ROS 1 bag whose index states wrong lengths", _ROS1, bag_damage.falsify_index, 1.0, quick=True),
    _case("ROS 1 bag, 50 kB of zeros in it", _ROS1, partial(bag_damage.zero, share=0.5, size=50_000), 0.9),
    _case("ROS 1 bag, a damaged bz2 chunk", _BZ2, partial(bag_damage.zero, share=0.5, size=500), 0.4),
    _case("ROS 1 bag, 300 bits flipped", _ROS1, partial(bag_damage.flip_bits, number=300), 0.9),
    _case("definition of another topic unreadable", _ROS1, bag_damage.spoil_definition, 1.0),
    _case("ROS 2 bag without metadata.yaml", _MCAP, _without_metadata, 1.0, quick=True),
    _case("ROS 2 bag, metadata.yaml spoilt", _MCAP, _with_broken_metadata, 1.0),
    _case("mcap cut in half", _MCAP, _half, 0.48),
    _case("mcap, 50 kB of zeros in it", _MCAP, partial(bag_damage.zero, share=0.5, size=50_000), 0.6),
    _case("sqlite database cut in half", _MCAP, _half, 0.48, quick=True, as_database=True),
    FaultCase("sqlite database that holds nothing", partial(_refused, damage=bag_damage.empty_database), quick=True),
    FaultCase(
        "sqlite database overwritten by zeros",
        partial(_refused, damage=partial(bag_damage.zero, share=0.0, size=10**8)),
    ),
)
