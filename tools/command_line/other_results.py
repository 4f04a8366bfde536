"""What an output folder must not hold: results of other programs and recordings, which a new result would replace."""

from collections.abc import Iterable
from pathlib import Path

from tbmslam.io.map_folder import FIXED_NAMES
from tbmslam.io.map_npz import is_merged_map
from tools.command_line.checksums import NAME as CHECKSUMS
from tools.command_line.checksums import RUN_FILES
from tools.command_line.extra_files import EDIT_FILES, EXTRA_FILES
from tools.command_line.output_folder import OutputError

_MAPPED, _MERGED, _MAP, _BAG = "run.json", "report.json", "map.npz", "metadata.yaml"
_EDITS = EDIT_FILES[0]
_OURS = (*FIXED_NAMES, *RUN_FILES, *EXTRA_FILES, *EDIT_FILES)
"""Names of the files that results consist of."""
_SHOWN = 3


def refuse_other_results(out: Path, *, of_merge: bool) -> None:
    """Refuse a folder with a result of another kind, or with files of other origin that would be replaced.

    A merge may replace an earlier merge, also an interrupted one, but no edited or converted merged map. A map that is
    converted or edited may replace a finished one of its kind.
    """
    names = _names_in(out)
    remedy = "choose another folder"
    if _MAPPED in names:
        raise OutputError(f"{out}: holds the map of a robot ({_MAPPED}), which would be replaced: {remedy}")
    if _BAG in names:
        raise OutputError(f"{out}: is the folder of a ROS bag: {remedy}")
    if of_merge and (_MERGED in names or _is_interrupted_merge(out, names)):
        return
    if _MERGED in names:
        raise OutputError(f"{out}: holds a merged map ({_MERGED}), which would be replaced: {remedy}")
    if not of_merge and _MAP in names:
        if CHECKSUMS in names:
            return
        what = f"an unfinished result or a map of other origin ({_MAP} without {CHECKSUMS})"
        raise OutputError(f"{out}: holds {what}, which would be replaced: delete it, or {remedy}")
    if there := [name for name in _OURS if name in names]:
        shown = ", ".join(there[:_SHOWN]) + (", ..." if len(there) > _SHOWN else "")
        why = "which no merge wrote and which would be replaced" if of_merge else "which would be replaced"
        if not of_merge and set(there) <= set(RUN_FILES):
            why = "which would not belong to the new map"
        raise OutputError(f"{out}: holds {shown}, {why}: {remedy}")


def refuse_to_map_over(out: Path, folders: Iterable[Path]) -> None:
    """Refuse folders of robots that hold a map of another program or command, and a merged map beside them.

    A map of the robot may be replaced, also an unfinished one.
    """
    for folder in (out, *folders):
        names = _names_in(folder)
        remedy = "which would be replaced: choose another folder"
        if _MERGED in names and _MAPPED not in names:
            what = "a merged map and its report" if folder == out else "a merged map"
            raise OutputError(f"{folder}: holds {what} ({_MERGED}), {remedy}")
        if folder != out and (found := _other_map(folder, names)):
            raise OutputError(f"{folder}: holds {found}, {remedy}")


def _other_map(folder: Path, names: set[str]) -> str | None:
    """Return what a robot's folder holds in place of its map; None if it is free or holds a map that `map` wrote."""
    if _EDITS in names:
        return f"an edited map ({_EDITS})"
    if _MAPPED in names:
        return None
    if {CHECKSUMS, _MAP} <= names:
        return f"a converted map ({CHECKSUMS} without {_MAPPED})"
    if is_merged_map(folder / _MAP):
        return f"a merged map ({_MAP})"
    there = [name for name in FIXED_NAMES if name in names]
    return ", ".join(there[:_SHOWN]) if there and _MAP not in names else None


def _is_interrupted_merge(folder: Path, names: set[str]) -> bool:
    """Return whether a merge began to write its map; an edited or a converted map names the merged maps, too."""
    return not {_EDITS, CHECKSUMS} & names and is_merged_map(folder / _MAP)


def _names_in(folder: Path) -> set[str]:
    """Return the names of files; none where they cannot be listed, which is reported when the folder is written."""
    try:
        return {file.name for file in folder.iterdir()}
    except OSError:
        return set()
