"""The wheel in an environment of its own, beside another project whose packages are called `datasets` and `tools`."""

import hashlib
import os
import re
import subprocess
import sys
import sysconfig
import zipfile
from base64 import urlsafe_b64encode
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.slow

LIBRARY = """
import datasets, tools
assert datasets.whose == tools.whose == "others"
from merging import align, merge
from tbmslam import Slam, open_recording
maps = {}
for name in ("robot_0", "robot_1"):
    slam = Slam(name=name)
    for reading in open_recording([f"bags/{name}.bag"]):
        slam.process(reading)
    maps[name] = slam.finish()
print(align(*maps.values()).accepted, sorted(merge(maps).poses))
"""


def other_project(folder):
    """Write a wheel of a project that has packages `datasets` and `tools`."""
    files = {f"{name}/__init__.py": b"whose = 'others'\n" for name in ("datasets", "tools")}
    files["datasets-9.0.dist-info/METADATA"] = b"Metadata-Version: 2.1\nName: datasets\nVersion: 9.0\n"
    files["datasets-9.0.dist-info/WHEEL"] = b"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    record = "datasets-9.0.dist-info/RECORD"
    lines = [
        f"{name},sha256={urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b'=').decode()},{len(data)}"
        for name, data in files.items()
    ]
    files[record] = "\n".join([*lines, f"{record},,", ""]).encode()
    wheel = folder / "datasets-9.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return wheel


def shell(*words, cwd, **more):
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")} | more
    done = subprocess.run(  # noqa: S603 - our own commands
        list(map(str, words)), cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    build = ("-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "-w", folder, ROOT)
    shell(sys.executable, *build, cwd=folder)
    (made,) = folder.glob("tbmslam-*.whl")
    return made


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A fresh environment that finds our dependencies where this one has them, but not this source tree."""
    folder = tmp_path_factory.mktemp("fresh")
    shell(sys.executable, "-m", "venv", folder / "venv", cwd=folder)
    home = Path(
        shell(folder / "venv/bin/python", "-c", "import site; print(site.getsitepackages()[0])", cwd=folder).strip()
    )
    (home / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    install = ("-m", "pip", "install", "--quiet", "--no-deps", "--no-index")
    shell(folder / "venv/bin/python", *install, other_project(folder), wheel, cwd=folder)
    return folder


def test_a_wheel_brings_no_name_but_its_own(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        top = {name.partition("/")[0] for name in names}
        assert {name for name in top if not name.endswith(".dist-info")} == {"tbmslam", "merging"}
        assert {"tbmslam/py.typed", "merging/py.typed", "tbmslam/datasets/known_recordings.toml"} <= set(names)
        programs = [archive.read(f"tbmslam/tools/{name}.py").decode() for name in ("build_maps", "download")]
    assert not any("python tools/" in text for text in programs)
    assert "tbmslam map" in programs[1]


@pytest.mark.parametrize("program", ["build_maps", "merge"])
def test_the_programs_of_a_clone_run_where_its_wheel_is_installed(installed, program):
    text = shell(installed / "venv/bin/python", f"tools/{program}.py", "--help", cwd=ROOT)
    assert text.startswith(f"usage: {program}")


def test_a_wheel_that_the_forge_builds_leads_to_the_project(tmp_path):
    home = "https://forge.example/team/maps"
    forge = {"GITHUB_SERVER_URL": "https://forge.example", "GITHUB_REPOSITORY": "team/maps", "GITHUB_REF_NAME": "v9"}
    build = ("-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "-w", tmp_path, ROOT)
    shell(sys.executable, *build, cwd=tmp_path, **forge)
    (made,) = tmp_path.glob("tbmslam-*.whl")
    with zipfile.ZipFile(made) as archive:
        (name,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        text = archive.read(name).decode()
    assert f"Project-URL: Source, {home}\n" in text
    assert f"Project-URL: Issues, {home}/issues\n" in text
    assert f"]({home}/raw/v9/docs/merged-office.png)" in text
    assert f"[own recordings]({home}/blob/v9/docs/own-recordings.md)" in text
    assert not re.search(r"\]\((?!https://)", text)


def test_the_commands_and_the_library_work_beside_the_other_project(installed):
    bin_folder = installed / "venv" / "bin"
    python = bin_folder / "python"
    small = ("--world", "apartment", "--robots", 2, "--seed", 3, "--beams", 181, "--rate", 5, "--length", 25)
    command = bin_folder / "tbmslam"
    shell(command, "world", *small, "--overlap", 0.6, "-o", "bags", cwd=installed)
    said = shell(command, "map", "bags", "--separate", "--workers", 2, "-o", "maps", cwd=installed)
    assert "report -> maps/report.html" in said
    said = shell(command, "merge", "maps", "-o", "merged", cwd=installed)
    assert said.splitlines()[-1] == "merged robot_0, robot_1 into merged"
    assert "stata/2011-01-24-06-18-27" in shell(command, "download", "--list", cwd=installed)
    for name in ("evaluate", "benchmark"):
        assert f"usage: tbmslam {name}" in shell(command, name, "--help", cwd=installed)
    assert shell(command, "--version", cwd=installed) == shell(python, "-m", "tbmslam", "--version", cwd=installed)
    assert shell(python, "-c", LIBRARY, cwd=installed) == "True ['robot_0', 'robot_1']\n"


def test_removing_it_leaves_the_other_project_whole(installed):
    python = installed / "venv" / "bin" / "python"
    shell(python, "-m", "pip", "uninstall", "--quiet", "--yes", "tbmslam", cwd=installed)
    code = "import datasets, tools; print(datasets.whose, tools.whose)"
    assert shell(python, "-c", code, cwd=installed) == "others others\n"
