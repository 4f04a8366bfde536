"""Edit a map by hand: crop it, turn it to the axes, erase, draw walls, forbid areas.

Edits are kept as a list, edits.toml beside the map, and can be applied again when the map is built again.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from tbmslam.errors import TbmSlamError
from tools.command_line.extra_files import add_extra_files, check_extra_files, write_extra_files
from tools.command_line.paths import check_exist, path_argument, refuse_to_overwrite
from tools.command_line.program import ProgramParser, run_program

if TYPE_CHECKING:
    from tbmslam.map.tbm_map import TbmMap

EXAMPLES = """examples:
  tbmslam edit out/one/run --align-axes --crop -5 -5 30 20 -o out/plan
      walls along the axes, then only a rectangle
  tbmslam edit out/one/run --erase 3 4 5 6 --wall 0 2 0 8 --keepout 10 0 12 4 -o out/plan
      a parked trolley erased, a glass wall drawn, an area forbidden (keepout.yaml for nav2)
  tbmslam edit out/two/run --edits out/plan/edits.toml -o out/plan-two
      the same edits of a map built again in the same frame

Edits are applied in the order of the command line, those of --edits first. Coordinates are metres in the frame that the
map has by then. The result keeps trajectories but no scans: a merge would draw the map from them again.
"""
EDITS, KEEPOUT, _ALIGN = "edits.toml", "keepout", "align-axes"
_CORNERS = ("X0", "Y0", "X1", "Y1")


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
    edits = grammar.add_argument_group("edits; each may be repeated")
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
    from tools.command_line.output_folder import output_folder

    masks = (f"{KEEPOUT}.yaml", f"{KEEPOUT}.pgm")
    refuse_to_overwrite(files_of_map(args.map), (args.out / name for name in (*FIXED_NAMES, *masks)))
    wanted = [*(_read_edits(args.edits) if args.edits else []), *(args.wanted or [])]
    tbm_map, mask, done = _applied(load_map(args.map), wanted)
    tbm_map = without_scans(tbm_map)
    with output_folder(args.out):
        save_map(args.out, tbm_map)
        write_extra_files(args.out, tbm_map, args)
        _write_edits(args.out / EDITS, done)
        for name in masks:
            (args.out / name).unlink(missing_ok=True)
        if mask is not None:
            write_ros_map(args.out / masks[0], mask.grid)
        write_checksums(args.out)
    print(f"{args.map}: {tbm_map.grid.summary()} -> {args.out}")


def _applied(
    tbm_map: "TbmMap", wanted: Sequence[tuple[str, tuple[float, ...]]]
) -> "tuple[TbmMap, TbmMap | None, list[tuple[str, tuple[float, ...]]]]":
    """Return an edited map, the mask of forbidden areas if there are any, and the edits for a repetition."""
    from tbmslam.map.edits import MapEdit, angle_to_axes, keepout_mask

    mask: TbmMap | None = None
    done = []
    for kind, given in wanted:
        values = given
        try:
            if kind == KEEPOUT:
                mask = MapEdit("occupy", values).applied(mask or keepout_mask(tbm_map.grid.geometry))
                done.append((kind, values))
                continue
            aligns = kind == _ALIGN
            edit = MapEdit("rotate", (angle_to_axes(tbm_map.grid),)) if aligns else MapEdit(cast("Any", kind), values)
            tbm_map = edit.applied(tbm_map)
            if mask is not None and edit.kind in ("crop", "rotate"):
                mask = edit.applied(mask)
        except ValueError as error:
            raise TbmSlamError(f"--{kind}: {error}: correct it") from None
        done.append((edit.kind, edit.values))
    return tbm_map, mask, done


def _read_edits(path: Path) -> list[tuple[str, tuple[float, ...]]]:
    """Return the edits of a file, kinds and numbers."""
    import tomllib

    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))["edit"]
        return [(str(table["kind"]), tuple(float(value) for value in table["values"])) for table in tables]
    except OSError as error:
        raise TbmSlamError(f"{path}: cannot be read: {error.strerror}: name the {EDITS} of an edited map") from error
    except (ValueError, KeyError, TypeError) as error:
        raise TbmSlamError(f"{path}: holds no list of edits ({error}): name the {EDITS} of an edited map") from error


def _write_edits(path: Path, done: Sequence[tuple[str, Sequence[float]]]) -> None:
    from tbmslam.io.atomic_file import write_text

    tables = [f'[[edit]]\nkind = "{kind}"\nvalues = [{", ".join(map(repr, values))}]\n' for kind, values in done]
    write_text(path, "\n".join(tables))


if __name__ == "__main__":
    sys.exit(main())
