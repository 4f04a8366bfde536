"""Every dependency has wheels for the machines that people use, and all of them together are not too large."""

import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
GLIBC = ("manylinux_2_28", "manylinux_2_27", "manylinux_2_17", "manylinux2014")
PLATFORMS = {
    "Windows": ["win_amd64"],
    "macOS": [f"macosx_{version}_0_arm64" for version in (11, 12, 13, 14)],
    "Linux": ["manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"],
    "Linux on ARM": [
        "manylinux_2_28_aarch64",
        "manylinux_2_27_aarch64",
        "manylinux_2_17_aarch64",
        "manylinux2014_aarch64",
    ],
}
NO_REGISTRY = ("No matching distribution found for numpy", "Could not fetch", "Network is unreachable")


@pytest.mark.slow
@pytest.mark.parametrize("python", ["3.11", "3.14"])
@pytest.mark.parametrize("machine", PLATFORMS)
def test_every_dependency_has_a_wheel(machine, python, tmp_path):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    platforms = [word for platform in PLATFORMS[machine] for word in ("--platform", platform)]
    how = ["--dry-run", "--quiet", "--disable-pip-version-check", "--ignore-installed", "--target", tmp_path]
    what = ["--only-binary=:all:", "--python-version", python, *platforms, *project["dependencies"]]
    done = subprocess.run(  # noqa: S603 - pip with our own dependencies
        [sys.executable, "-m", "pip", "install", *how, *what], capture_output=True, text=True, check=False
    )
    if any(what in done.stderr for what in NO_REGISTRY):
        pytest.skip("no package registry can be reached")
    assert done.returncode == 0, done.stderr


def installed_with(name):
    """Return the names of a distribution and of all that it needs here, without extras."""
    found, waiting = set(), [name]
    while waiting:
        name = canonicalize_name(waiting.pop())
        if name not in found:
            found.add(name)
            needed = [Requirement(line) for line in metadata.requires(name) or ()]
            waiting += [each.name for each in needed if each.marker is None or each.marker.evaluate({"extra": ""})]
    return found


def test_what_is_installed_is_not_too_large():
    names = installed_with("tbmslam")
    assert "numpy" in names
    files = [Path(str(file.locate())) for name in names for file in metadata.files(name) or () if file.suffix != ".pyc"]
    megabytes = sum(file.stat().st_size for file in files if file.exists()) / 1e6
    assert 400.0 < megabytes < 600.0  # 592 with the releases of November 2026
