"""The same input and parameters give the same bytes, whoever computes and whatever was compiled before."""

import pytest

from tests.end_to_end.programs import build, contents, merge_maps, simulate
from tests.processes import ROOT, python

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("same bytes")]


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    small = ("--beams", 181, "--rate", 5, "--duration", 20)
    return simulate(tmp_path_factory.mktemp("bags"), "--world", "apartment", "--robots", 3, *small)


@pytest.fixture(scope="module")
def expected(bags, tmp_path_factory):
    """Every file of maps and merge, made by one process that has the compiled code at hand."""
    root = tmp_path_factory.mktemp("expected")
    build(root / "maps", bags, "--separate")
    merge_maps(root / "merged", root / "maps")
    made = contents(root)
    assert {"maps/robot_2/SHA256SUMS", "merged/SHA256SUMS", "merged/report.json", "merged/map.npz"} <= made.keys()
    return made


@pytest.mark.parametrize("workers", [1, 2])
def test_any_number_of_workers(bags, expected, tmp_path, workers):
    build(tmp_path / "maps", bags, "--separate", "--workers", workers)
    merge_maps(tmp_path / "merged", tmp_path / "maps", "--workers", workers)
    assert contents(tmp_path) == expected


def test_with_and_without_compiled_code_at_hand(bags, expected, tmp_path):
    """First nothing is compiled yet; then another process finds what the first left."""
    for name in ("cold", "warm"):
        folder = tmp_path / name
        shell(tmp_path, "build_maps", bags, "--separate", "-o", folder / "maps")
        shell(tmp_path, "merge", folder / "maps", "-o", folder / "merged")
        assert contents(folder) == expected


def shell(folder, program, *arguments):
    """Run a program with a cache of compiled code of its own."""
    done = python(ROOT / "tools" / f"{program}.py", *arguments, NUMBA_CACHE_DIR=str(folder / "cache"))
    assert done.returncode == 0, done.stderr
    assert any((folder / "cache").rglob("*.nbc"))
