"""The report of robots that were mapped, each in a frame of its own."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from tbmslam.map.drive import Drive
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.map_layers import ROBOT_COLOURS, drive_layers, map_layers, trouble_layer
from tbmslam.report.page import Making, Page, Table
from tbmslam.report.sheet import Sheet
from tbmslam.report.timed_way import timed_ways

_MOST_NAMES = 5
"""So many robots are named where several are told the same."""


def by_whom(told: Mapping[str, Iterable[str]]) -> list[str]:
    """Return every warning once, with the names of those that it is told of: one recording's are those of all.

    Parameters
    ----------
    told
        What each robot is told, by name. What happened at several times is one warning with all of them; of two robots
        it is one only where the times are the same.
    """
    whose: dict[str, list[str]] = {}
    for name, warnings in told.items():
        for warning in _gathered(dict.fromkeys(warnings)):
            whose.setdefault(warning, []).append(name)
    return [f"{_listed(names)}: {warning}" for warning, names in whose.items()]


_TIMED, _LASTS = re.compile(r"at ([\d.]+) s: (.*)"), re.compile(r", for [\d.]+ s")
_MOST_TIMES = 5


def _gathered(warnings: Iterable[str]) -> list[str]:
    """Return warnings, those that tell of the same at other times as one."""
    times: dict[str, list[tuple[str, str]]] = {}
    for warning in warnings:
        timed = _TIMED.fullmatch(warning)
        what, at = (_LASTS.sub("", timed[2]), timed[1]) if timed else (warning, "")
        times.setdefault(what, []).append((at, warning))
    said = []
    for what, found in times.items():
        if len(found) == 1:
            said.append(found[0][1])
            continue
        more = f" and {len(found) - _MOST_TIMES} more times" if len(found) > _MOST_TIMES else ""
        said.append(f"at {', '.join(at for at, _ in found[:_MOST_TIMES])} s{more}: {what}")
    return said


def _listed(names: list[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:_MOST_NAMES])} and {more} more"


_LARGE_CORRECTION_M = 1.0
MOST_SHEETS = 30
"""So many maps are shown; a page with hundreds would be too large to open."""


@dataclass(frozen=True)
class MappedRobot:
    """A map and how it came about.

    Parameters
    ----------
    tbm_map
        The map.
    run
        What run.json says: recording, counts, warnings, versions, config, result.
    """

    tbm_map: TbmMap
    run: Mapping[str, object] = field(default_factory=dict)

    def said(self, *path: str) -> object:
        """Return an entry of the run; None where there is none."""
        value: object = self.run
        for name in path:
            value = value.get(name) if isinstance(value, Mapping) else None
        return value

    def warnings(self) -> list[str]:
        """Return what was odd about the recording and the drive."""
        odd = self.said("warnings")
        said = [str(one) for one in odd] if isinstance(odd, list | tuple) else []
        correction = self.said("result", "correction_m")
        if isinstance(correction, float) and correction > _LARGE_CORRECTION_M:
            said.append(f"closing loops moved the drive by up to {correction:.1f} m: it had drifted by so much")
        wanted, cell = self.said("config", "map", "resolution"), self.tbm_map.grid.geometry.resolution
        if isinstance(wanted, float) and cell > 1.01 * wanted:
            said.append(f"the map is so large that its cells are {cell:g} m and not {wanted:g} m")
        length = sum(drive.trajectory.driven() for drive in self.tbm_map.drives)
        if length > 0.0 and not any(len(drive.closures) for drive in self.tbm_map.drives):
            said.append(f"no loop was closed in {length:.0f} m, so nothing tells how far the drive drifted")
        return said


def maps_page(
    robots: Mapping[str, MappedRobot],
    making: Making,
    failure: str | None = None,
    files: Mapping[str, Sequence[str]] | None = None,
) -> Page:
    """Return the page on what build_maps made.

    Parameters
    ----------
    robots
        The maps by name.
    making
        What was typed, and how long it took.
    failure
        What kept further robots from being mapped; None where nothing did.
    files
        Addresses of each robot's files, by its name.
    """
    colours = [ROBOT_COLOURS[index % len(ROBOT_COLOURS)] for index in range(len(robots))]
    first = next(iter(robots.values()))
    versions, config = first.said("versions"), first.said("config")
    return Page(
        title="Maps of " + (", ".join(robots) if len(robots) <= 3 else f"{len(robots)} robots"),
        verdict="1 map was made" if len(robots) == 1 else f"{len(robots)} maps were made, each in a frame of its own",
        good=failure is None,
        figures=_figures([robot.tbm_map for robot in robots.values()]),
        sheets=[
            _sheet(name, robot, colour)
            for (name, robot), colour in list(zip(robots.items(), colours, strict=True))[:MOST_SHEETS]
        ],
        warnings=([] if failure is None else [failure])
        + by_whom({name: robot.warnings() for name, robot in robots.items()}),
        tables=[_table(robots)],
        downloads=dict(list((files or {}).items())[:MOST_SHEETS]),
        seconds=making.seconds,
        command=making.command,
        versions={str(name): str(value) for name, value in versions.items()} if isinstance(versions, Mapping) else {},
        config=config if isinstance(config, Mapping) else {},
        defaults=making.defaults,
    )


def known_m2(tbm_map: TbmMap) -> float:
    """Return the area that a map knows something of [m^2]."""
    return float(tbm_map.grid.is_known().sum()) * tbm_map.grid.geometry.resolution**2


def _sheet(name: str, robot: MappedRobot, colour: tuple[int, int, int]) -> Sheet:
    tbm_map = robot.tbm_map
    drives, resolution = tbm_map.drives, tbm_map.grid.geometry.resolution
    trouble = [mark for drive in drives for mark in trouble_layer(drive, robot.said("incidents"), "Robot")]
    colours = [colour] * len(drives)
    ways = drive_layers(drives, colours, "Robot", resolution)
    return Sheet(name, (*map_layers(tbm_map.grid), *ways, *trouble), ways=timed_ways(drives, colours))


def _figures(maps: list[TbmMap]) -> dict[str, str]:
    drives = [drive for one in maps for drive in one.drives]
    return {
        "scans": f"{sum(len(drive.trajectory) for drive in drives):,}",
        "driven": f"{sum(drive.trajectory.driven() for drive in drives):.0f} m",
        "loops closed": f"{sum(len(drive.closures) for drive in drives):,}",
        "known area" if len(maps) == 1 else "known area of a map": _range([known_m2(one) for one in maps]),
    }


def _range(areas: list[float]) -> str:
    """Return the smallest and the largest area [m^2]; maps overlap, so that their sum says nothing."""
    low, high = f"{min(areas):.0f}", f"{max(areas):.0f}"
    return f"{high} m²" if low == high else f"{low} to {high} m²"


def _table(robots: Mapping[str, MappedRobot]) -> Table:
    heads = (
        *("robot", "recording", "#scans used", "#of", "#key-frames", "#driven [m]", "#duration [s]"),
        *("#loops closed", "#moved by loops [m]", "#known [m²]", "#cell [m]"),
    )
    rows = [row for name, robot in robots.items() for row in _rows(name, robot)]
    note = "“Moved by loops” is how far closing loops, and walls, moved the drive at the most."
    if len(robots) > MOST_SHEETS:
        note += f" Shown above are the first {MOST_SHEETS} of {len(robots)} maps."
    return Table("Robots", heads, rows, note)


def _rows(name: str, robot: MappedRobot) -> list[list[str]]:
    return [_row(name, robot, drive) for drive in robot.tbm_map.drives]


def _row(name: str, robot: MappedRobot, drive: Drive) -> list[str]:
    stamps = drive.trajectory.stamps
    read, moved = robot.said("counts", "scans_read"), robot.said("result", "correction_m")
    return [
        name,
        str(robot.said("recording", "name") or "–"),
        str(len(drive.trajectory)),
        str(read) if isinstance(read, int) else "–",
        str(len(drive.keyframes)),
        f"{drive.trajectory.driven():.1f}",
        f"{float(stamps.max() - stamps.min()):.1f}" if len(stamps) else "–",
        str(len(drive.closures)),
        f"{moved:.3f}" if isinstance(moved, float) else "–",
        f"{known_m2(robot.tbm_map):.1f}",
        f"{robot.tbm_map.grid.geometry.resolution:g}",
    ]
