"""Edit a map by hand: crop it, turn it to the axes, erase, draw walls, forbid areas.

Edits are kept as a list, edits.toml beside the map, and can be applied again when the map is built again.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from tbmslam.errors import TbmSlamError
from tools.command_line.extra_files import EDIT_FILES, add_extra_files, check_extra_files, write_extra_files
from tools.command_line.paths import check_exist, path_argument, refuse_to_overwrite
from tools.command_line.program import ProgramParser, run_program

if TYPE_CHECKING:
    from tbmslam.map.edits import MapEdit
    from tbmslam.map.tbm_map import TbmMap

EXAMPLES = """examples:
  tbmslam edit out/one/run --align-axes --crop -5 -5 30 20 -o out/plan
      walls along the axes, then only a rectangle
  tbmslam edit out/one/run --erase 3 4 5 6 --wall 0 2 0 8 --keepout 10 0 12 4 -o out/cleaned
      a parked trolley erased, a glass wall drawn, an area forbidden (keepout.yaml for nav2)
  tbmslam edit out/again/run --edits out/plan/edits.toml -o out/plan-again
      the same edits of a map that was built again in the same frame

Edits are applied in the order of the command line, those of --edits first. Coordinates are metres in the frame that the
map has by then. The edits.toml and the forbidden areas of an edited MAP are continued. The result keeps trajectories
but no scans: a merge would draw the map from them again.
"""
EDITS, *_MASKS = EDIT_FILES
KEEPOUT, _ALIGN = "keepout", "align-axes"
_CORNERS = ("X0", "Y0", "X1", "Y1")

Edit = tuple[str, tuple[float, ...]]
"""Kind and numbers of an edit."""


class _Append(argparse.Action):
    """Appends an option and its numbers to a common list in their order."""

    def __call__(self, _: object, namespace: argparse.Namespace, values: Any, option: str | None = None) -> None:
        kind = (option or "").lstrip("-")
        namespace.wanted = [*(namespace.wanted or []), (kind, tuple(values or ()))]


def parser(program: str = "edit") -> argparse.ArgumentParser:
    """Return the command line's grammar."""
    grammar = ProgramParser(prog=program, description=__doc__, epilog=EXAMPLES)
    grammar.add_argument("map", type=path_argument, metavar="MAP", help="folder or file of a map")
    grammar.add_argument("-o", "--out", type=path_argument, required=True, help="folder for the edited map")
    edits = grammar.add_argument_group("edits; each but --edits may be repeated")
    edits.set_defaults(wanted=None)
    for name, about in (
        ("crop", "keep this rectangle"),
        ("erase", "make this rectangle unknown"),
        ("free", "make this rectangle free"),
        ("occupy", "make this rectangle occupied"),
        ("wall", "draw a wall from point to point"),
        ("keepout", f"forbid this rectangle: {KEEPOUT}.yaml, the mask of nav2's keepout filter"),
    ):
        edits.add_argument(
            f"--{name}", nargs=4, type=float, action=_Append, dest="wanted", metavar=_CORNERS, help=f"{about} [m]"
        )
    edits.add_argument(
        "--rotate", nargs=1, type=float, action=_Append, dest="wanted", metavar="DEG",
        help="turn the map anticlockwise about the origin of its frame",
    )  # fmt: skip
    edits.add_argument("--align-axes", nargs=0, action=_Append, dest="wanted", help="turn the walls to the axes")
    edits.add_argument(
        "--edits", type=path_argument, metavar="FILE", help=f"apply the {EDITS} of an earlier edit first"
    )
    add_extra_files(grammar)
    grammar.add_argument("--debug", action="store_true", help="show a traceback when something fails")
    return grammar


def main(argv: list[str] | None = None, program: str = "edit") -> int:
    """Run the program, under the name that it was called by; return its exit code."""
    grammar = parser(program)
    args = grammar.parse_args(argv)
    if not args.wanted and args.edits is None:
        grammar.error("give an edit, such as --align-axes, or a file of --edits")
    return run_program(program, lambda: _run(args), debug=args.debug)


def _run(args: argparse.Namespace) -> None:
    check_exist([args.map], "does not exist: give a map's folder or file")
    check_extra_files(args)
    from tbmslam.io.map_folder import FIXED_NAMES, files_of_map, load_map, save_map
    from tbmslam.io.ros_map import write_ros_map
    from tbmslam.map.edits import without_scans
    from tools.command_line.checksums import write_checksums
    from tools.command_line.other_results import refuse_other_results
    from tools.command_line.output_folder import output_folder

    read = files_of_map(args.map)
    refuse_to_overwrite(read, (args.out / name for name in (*FIXED_NAMES, *_MASKS)))
    refuse_other_results(args.out, of_merge=False)
    tbm_map = load_map(args.map)
    earlier = _earlier_edits(read[0], tbm_map)
    wanted = _wanted_edits(args, earlier)
    tbm_map, mask, done = _applied(tbm_map, _earlier_mask(read[0].with_name(_MASKS[0]), earlier), wanted)
    tbm_map = without_scans(tbm_map)
    with output_folder(args.out):
        save_map(args.out, tbm_map)
        write_extra_files(args.out, tbm_map, args)
        _write_edits(args.out / EDITS, [*earlier, *done])
        for name in _MASKS:
            (args.out / name).unlink(missing_ok=True)
        if mask is not None:
            write_ros_map(args.out / _MASKS[0], mask.grid)
        write_checksums(args.out)
    print(f"{args.map}: {tbm_map.grid.summary()} -> {args.out}")


def _earlier_edits(map_file: Path, tbm_map: "TbmMap") -> list[Edit]:
    """Return the edits that a map already has: the list beside it, unless the map was built again since."""
    from tbmslam.io.map_folder import FIXED_NAMES

    path, has_scans = map_file.with_name(EDITS), any(len(drive.keyframes) for drive in tbm_map.drives)
    if map_file.name not in FIXED_NAMES or has_scans or not os.path.lexists(path):
        return []
    remedy = "restore it, or delete it to begin a new list"
    edits = _read_edits(path, remedy)
    try:
        for kind, values in edits:
            _map_edit(kind, values)
    except ValueError as error:
        raise _damaged(path, error, remedy) from None
    return edits


def _wanted_edits(args: argparse.Namespace, earlier: Sequence[Edit]) -> list[Edit]:
    """Return the edits of a file and of the command line; those of a file must not repeat those of the map."""
    given = _read_edits(args.edits, f"name the {EDITS} of an edited map") if args.edits else []
    common = min(len(given), len(earlier))
    if common and given[:common] == earlier[:common]:
        raise TbmSlamError(
            f"{args.edits}: repeats edits that {args.map} already has: edit the map without them, or omit --edits"
        )
    return [*given, *(args.wanted or [])]


def _earlier_mask(path: Path, earlier: Sequence[Edit]) -> "TbmMap | None":
    """Return the mask of the areas that earlier edits forbid, if there are any."""
    if not any(kind == KEEPOUT for kind, _ in earlier):
        return None
    from tbmslam.io.ros_map import read_ros_map_header
    from tbmslam.map.tbm_map import TbmMap

    check_exist([path], f"does not exist, but {EDITS} forbids areas: restore it, or repeat the edits by --edits")
    header = read_ros_map_header(path)
    return TbmMap.from_image(header.image, header.resolution, (header.T_map_image.x, header.T_map_image.y))


def _applied(
    tbm_map: "TbmMap", mask: "TbmMap | None", wanted: Sequence[Edit]
) -> "tuple[TbmMap, TbmMap | None, list[Edit]]":
    """Return an edited map, the mask of forbidden areas if there are any, and the edits for a repetition."""
    from tbmslam.map.edits import angle_to_axes, keepout_mask

    done: list[Edit] = []
    for kind, given in wanted:
        aligns = kind == _ALIGN
        try:
            edit = _map_edit("rotate", (angle_to_axes(tbm_map.grid),)) if aligns else _map_edit(kind, given)
            if kind == KEEPOUT:
                mask = edit.applied(mask or keepout_mask(tbm_map.grid.geometry))
            else:
                tbm_map = edit.applied(tbm_map)
                if mask is not None and edit.kind in ("crop", "rotate"):
                    mask = edit.applied(mask)
        except ValueError as error:
            raise TbmSlamError(f"--{kind}: {error}: correct it") from None
        done.append(("rotate" if aligns else kind, edit.values))
    return tbm_map, mask, done


def _map_edit(kind: str, values: tuple[float, ...]) -> "MapEdit":
    """Return the change of the map, or that of the mask: forbidden areas are occupied there."""
    from tbmslam.map.edits import MapEdit

    return MapEdit("occupy" if kind == KEEPOUT else cast("Any", kind), values)


def _read_edits(path: Path, remedy: str) -> list[Edit]:
    """Return the edits of a file."""
    import tomllib

    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))["edit"]
        return [(str(table["kind"]), tuple(float(value) for value in table["values"])) for table in tables]
    except OSError as error:
        raise TbmSlamError(f"{path}: cannot be read: {error.strerror}: {remedy}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise _damaged(path, error, remedy) from error


def _damaged(path: Path, error: Exception, remedy: str) -> TbmSlamError:
    return TbmSlamError(f"{path}: holds no list of edits ({error}): {remedy}")


def _write_edits(path: Path, edits: Sequence[Edit]) -> None:
    from tbmslam.io.atomic_file import write_text

    tables = [f'[[edit]]\nkind = "{kind}"\nvalues = [{", ".join(map(repr, values))}]\n' for kind, values in edits]
    write_text(path, "\n".join(tables))


if __name__ == "__main__":
    sys.exit(main())
