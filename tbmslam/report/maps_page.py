"""The report of the maps of several robots, each in its own frame."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from tbmslam.map.drive import Drive
from tbmslam.map.tbm_map import TbmMap
from tbmslam.report.map_layers import ROBOT_COLOURS, drive_layers, incident_layer, map_layers
from tbmslam.report.page import Page, RunInfo, Table
from tbmslam.report.repeated_warnings import gathered
from tbmslam.report.sheet import Sheet, drive_tracks

_MOST_NAMES = 5  # number of robots that are named in a warning of several robots


def joined_warnings(warnings: Mapping[str, Iterable[str]]) -> list[str]:
    """Return every warning once, with the names of its robots: robots of one recording share its warnings.

    Incidents of one kind become one warning with their times. Warnings of two robots are joined only if the times are
    equal.
    """
    names_of: dict[str, list[str]] = {}
    for name, of_robot in warnings.items():
        for warning in gathered(dict.fromkeys(of_robot)):
            names_of.setdefault(warning, []).append(name)
    return [f"{_listed(names)}: {warning}" for warning, names in names_of.items()]


def _listed(names: list[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:_MOST_NAMES])} and {more} more"


_LARGE_CORRECTION_M = 1.0
MOST_SHEETS = 30
"""Number of maps that are shown; a page with hundreds would be too large to open."""


@dataclass(frozen=True)
class MappedRobot:
    """A map and the run that made it."""

    tbm_map: TbmMap
    run: Mapping[str, object] = field(default_factory=dict)
    """The content of run.json: recording, counts, warnings, versions, config, result."""

    def entry(self, *path: str) -> object:
        """Return an entry of the run, or None."""
        value: object = self.run
        for name in path:
            value = value.get(name) if isinstance(value, Mapping) else None
        return value

    def warnings(self) -> list[str]:
        """Return the warnings about the recording and the drive."""
        recorded = self.entry("warnings")
        warnings = [str(warning) for warning in recorded] if isinstance(recorded, list | tuple) else []
        correction = self.entry("result", "correction_m")
        if isinstance(correction, float) and correction > _LARGE_CORRECTION_M:
            warnings.append(f"closing loops moved the drive by up to {correction:.1f} m, because it had drifted")
        wanted, cell = self.entry("config", "map", "resolution"), self.tbm_map.grid.geometry.resolution
        if isinstance(wanted, float) and cell > 1.01 * wanted:
            warnings.append(f"the map is so large that its cells are {cell:g} m and not {wanted:g} m")
        length = sum(drive.trajectory.driven() for drive in self.tbm_map.drives)
        if length > 0.0 and not any(len(drive.closures) for drive in self.tbm_map.drives):
            warnings.append(f"no loop was closed in {length:.0f} m, so the drift of the drive is unknown")
        return warnings


def maps_page(
    robots: Mapping[str, MappedRobot],
    run_info: RunInfo,
    failure: str | None = None,
    files: Mapping[str, Sequence[str]] | None = None,
) -> Page:
    """Return the report of build_maps.

    `failure` is the error that prevented further maps, and `files` has the addresses of each robot's files by its name.
    """
    colours = [ROBOT_COLOURS[index % len(ROBOT_COLOURS)] for index in range(len(robots))]
    first = next(iter(robots.values()))
    versions, config = first.entry("versions"), first.entry("config")
    return Page(
        title="Maps of " + (", ".join(robots) if len(robots) <= 3 else f"{len(robots)} robots"),
        verdict="1 map was made" if len(robots) == 1 else f"{len(robots)} maps were made, each in its own frame",
        good=failure is None,
        figures=_figures([robot.tbm_map for robot in robots.values()]),
        sheets=[
            _sheet(name, robot, colour)
            for (name, robot), colour in list(zip(robots.items(), colours, strict=True))[:MOST_SHEETS]
        ],
        warnings=([] if failure is None else [failure])
        + joined_warnings({name: robot.warnings() for name, robot in robots.items()}),
        tables=[_table(robots)],
        downloads=dict(list((files or {}).items())[:MOST_SHEETS]),
        seconds=run_info.seconds,
        command=run_info.command,
        versions={str(name): str(value) for name, value in versions.items()} if isinstance(versions, Mapping) else {},
        config=config if isinstance(config, Mapping) else {},
        defaults=run_info.defaults,
    )


def _sheet(name: str, robot: MappedRobot, colour: tuple[int, int, int]) -> Sheet:
    tbm_map = robot.tbm_map
    drives, resolution = tbm_map.drives, tbm_map.grid.geometry.resolution
    incidents = [mark for drive in drives for mark in incident_layer(drive, robot.entry("incidents"), "Robot")]
    colours = [colour] * len(drives)
    lines = drive_layers(drives, colours, "Robot", resolution)
    return Sheet(name, (*map_layers(tbm_map.grid), *lines, *incidents), tracks=drive_tracks(drives, colours))


def _figures(maps: list[TbmMap]) -> dict[str, str]:
    drives = [drive for one in maps for drive in one.drives]
    return {
        "scans": f"{sum(len(drive.trajectory) for drive in drives):,}",
        "driven": f"{sum(drive.trajectory.driven() for drive in drives):.0f} m",
        "loops closed": f"{sum(len(drive.closures) for drive in drives):,}",
        "known area" if len(maps) == 1 else "known area of a map": _range([one.grid.known_m2() for one in maps]),
    }


def _range(areas: list[float]) -> str:
    """Return the smallest and the largest area [m^2] as text; a sum would count overlaps twice."""
    low, high = f"{min(areas):.0f}", f"{max(areas):.0f}"
    return f"{high} m²" if low == high else f"{low} to {high} m²"


def _table(robots: Mapping[str, MappedRobot]) -> Table:
    heads = (
        *("robot", "recording", "#scans used", "#of", "#key\u00adframes", "#driven [m]", "#duration [s]"),
        *("#loops closed", "#moved by loops [m]", "#known [m²]", "#cell [m]"),
    )
    rows = [_row(name, robot, drive) for name, robot in robots.items() for drive in robot.tbm_map.drives]
    note = "“Moved by loops” is the largest distance by which loop closures and walls moved the drive."
    if len(robots) > MOST_SHEETS:
        note += f" Only the first {MOST_SHEETS} of {len(robots)} maps are shown above."
    return Table("Robots", heads, rows, note)


def _row(name: str, robot: MappedRobot, drive: Drive) -> list[str]:
    stamps = drive.trajectory.stamps
    read, moved = robot.entry("counts", "scans_read"), robot.entry("result", "correction_m")
    return [
        name,
        str(robot.entry("recording", "name") or "–"),
        str(len(drive.trajectory)),
        str(read) if isinstance(read, int) else "–",
        str(len(drive.keyframes)),
        f"{drive.trajectory.driven():.1f}",
        f"{float(stamps.max() - stamps.min()):.1f}" if len(stamps) else "–",
        str(len(drive.closures)),
        f"{moved:.3f}" if isinstance(moved, float) else "–",
        f"{robot.tbm_map.grid.known_m2():.1f}",
        f"{robot.tbm_map.grid.geometry.resolution:g}",
    ]
