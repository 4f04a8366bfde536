"""Every dependency has wheels for the machines that people use: nobody needs a compiler."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

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
