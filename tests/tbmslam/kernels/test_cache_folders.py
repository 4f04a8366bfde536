import ast
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tbmslam.kernels.cache_folders import cache_folder, cache_root, imported_files

PACKAGE = Path(__file__).parents[3] / "tbmslam"
HEAD = "from tbmslam.kernels import kernel\n"
KERNELS = {
    "inner": HEAD.replace("kernel\n", "part\n") + "\n\n@part\ndef inner(x):\n    return x + 1\n",
    "middle": HEAD + "from tbmslam.kernels.inner import inner\n\n\n@kernel\ndef middle(x):\n    return inner(x)\n",
    "outer": HEAD + "from tbmslam.kernels.middle import middle\n\n\n@kernel\ndef outer(x):\n    return middle(x)\n",
    "other": HEAD + "\n\n@kernel\ndef other(x):\n    return x - 1\n",
}
FORKING = """
import json, os, sys, traceback
import numba.np.arraymath
from numba.core import config
numba.njit(lambda x: x + 1)(1)

def run(settings, output):
    os.dup2(output, 1)
    os.environ.clear()
    os.environ.update(settings)
    config.reload_config()
    sys.path.insert(0, settings["PYTHONPATH"])
    try:
        from tbmslam.kernels.other import other
        from tbmslam.kernels.outer import outer
        for kernel in (outer, other):
            print(kernel(1), sum(kernel.stats.cache_hits.values()), flush=True)
    except BaseException:
        traceback.print_exc()
    os._exit(0)

for line in sys.stdin:
    started = []
    for settings in json.loads(line):
        reader, writer = os.pipe()
        if not (child := os.fork()):
            run(settings, writer)
        os.close(writer)
        started.append((child, reader))
    said = []
    for child, reader in started:
        with os.fdopen(reader) as output:
            said.append(output.read().split())
        os.waitpid(child, 0)
    print(json.dumps(said), flush=True)
"""
"""Runs kernels in processes forked from one that has loaded and started numba, which takes seconds, but no kernel."""

# One worker compiles for all of them.
pytestmark = pytest.mark.xdist_group("cache folders")


@pytest.fixture(scope="module")
def run_at_once():
    """Return a function that runs the kernels of packages at once, each in a process of its own."""
    if not hasattr(os, "fork"):
        pytest.skip("needs fork")
    own = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    command = [sys.executable, "-B", "-c", FORKING]
    with subprocess.Popen(  # noqa: S603 - our code
        command, env=own, cwd="/", stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:

        def run(*packages, **changes):
            all_settings = []
            for package in packages:
                folder = package.parents[1]
                places = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
                all_settings.append({**own, **places, **changes})
            process.stdin.write(json.dumps(all_settings) + "\n")
            process.stdin.flush()
            return json.loads(process.stdout.readline())

        yield run
        process.stdin.close()


@pytest.fixture(scope="module")
def run(run_at_once):
    return lambda package, **changes: run_at_once(package, **changes)[0]


def package_in(folder):
    """Return the folder of a package of four small files of kernels."""
    kernels = folder / "tbmslam" / "kernels"
    kernels.mkdir(parents=True)
    shared = ("__init__", "cache_folders", "cache_locator", "kernel_compiler", "remembered_types")
    for name in ("__init__.py", "lazy_names.py", *(f"kernels/{name}.py" for name in shared)):
        shutil.copy(PACKAGE / name, folder / "tbmslam" / name)
    for name, text in KERNELS.items():
        (kernels / f"{name}.py").write_text(text, encoding="utf-8")
    return kernels


@pytest.fixture
def package(tmp_path):
    return package_in(tmp_path)


@pytest.fixture(scope="module")
def compiled_once(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("compiled")
    assert run(package_in(folder)) == ["2", "0", "0", "0"]
    return folder


@pytest.fixture
def compiled(compiled_once, tmp_path):
    """Return the folder of a copy of a package whose kernels are compiled; its first test shows that they are."""
    shutil.copytree(compiled_once, tmp_path, dirs_exist_ok=True)
    return tmp_path / "tbmslam" / "kernels"


def test_a_change_of_a_callee_recompiles_its_callers_and_nothing_else(run, compiled):
    assert run(compiled) == ["2", "1", "0", "1"]
    (compiled / "inner.py").write_text(KERNELS["inner"].replace("x + 1", "x + 7"), encoding="utf-8")
    assert run(compiled) == ["8", "0", "0", "1"]
    (compiled / "other.py").write_text(KERNELS["other"].replace("x - 1", "x - 2"), encoding="utf-8")
    assert run(compiled) == ["8", "1", "-1", "0"]


@pytest.mark.parametrize("name", ["kernel_compiler", "remembered_types"])
def test_a_change_of_the_compiler_recompiles_all_kernels(run, compiled, name):
    compiler = compiled / f"{name}.py"
    compiler.write_text(compiler.read_text(encoding="utf-8") + "# changed\n", encoding="utf-8")
    assert run(compiled) == ["2", "0", "0", "0"]


def test_a_second_installation_compiles_nothing(run, compiled, tmp_path):
    copied = tmp_path / "elsewhere" / "tbmslam"
    shutil.copytree(compiled.parent, copied, copy_function=shutil.copyfile)  # with other time stamps
    assert run(copied / "kernels", NUMBA_CACHE_DIR=str(tmp_path / "cache")) == ["2", "1", "0", "1"]


def test_the_check_of_bounds_has_a_cache_of_its_own(run, compiled):
    assert run(compiled, NUMBA_BOUNDSCHECK="1") == ["2", "0", "0", "0"]
    assert run(compiled, NUMBA_BOUNDSCHECK="1") == ["2", "1", "0", "1"]


def test_several_processes_compile_at_once(run, run_at_once, package):
    said = run_at_once(package, package)
    assert [(each[0], each[2]) for each in said] == [("2", "0")] * 2
    assert run(package) == ["2", "1", "0", "1"]


def test_a_place_where_nothing_can_be_made_is_done_without(run, package):
    blocked = package.parents[1] / "cache"
    blocked.mkdir()
    (blocked / "tbmslam").write_bytes(b"")
    assert run(package) == ["2", "0", "0", "0"]
    assert not list(package.rglob("*.nbi"))


def test_a_folder_in_which_no_one_can_write_is_done_without(tmp_path, monkeypatch):
    def refuse(**_):
        raise PermissionError

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    assert cache_folder(PACKAGE / "kernels" / "rays" / "hits.py", tmp_path) is None
    assert cache_folder(tmp_path / "archive.zip" / "hits.py", tmp_path) is None


def test_the_place_is_the_one_asked_for(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    assert cache_root() == tmp_path / "user" / "tbmslam"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    assert cache_root() == tmp_path / "numba" / "tbmslam"


def test_old_folders_go_when_a_new_one_is_made(tmp_path):
    names = [f"hits-{number:016x}" for number in range(25)]
    for age, name in enumerate([*names, "scoring-00000000000000aa", "00000000000000bb", "not-ours", "old-not-ours"]):
        (tmp_path / name).mkdir()
        used = time.time() - (age if age < 25 else 31 * 86400)
        os.utime(tmp_path / name, (used, used))
    folder = cache_folder(PACKAGE / "kernels" / "rays" / "hits.py", tmp_path)
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {folder.name, *names[:19], "not-ours", "old-not-ours"}


def test_a_folder_in_use_is_marked_as_used(tmp_path):
    folder = cache_folder(PACKAGE / "kernels" / "rays" / "hits.py", tmp_path)
    os.utime(folder, (0, 0))
    assert cache_folder(PACKAGE / "kernels" / "rays" / "hits.py", tmp_path) == folder
    assert time.time() - folder.stat().st_mtime < 60.0


@pytest.mark.parametrize("path", sorted((PACKAGE / "kernels").glob("[a-z]*.py")), ids=lambda path: path.stem)
def test_all_imports_of_a_file_of_kernels_are_found(path):
    text = path.read_bytes()
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    from_them = [node.module or "." for node in nodes if isinstance(node, ast.ImportFrom)]
    ours = {name for name in from_them if name.startswith((".", "tbmslam"))}
    assert not [
        name.name for node in nodes if isinstance(node, ast.Import) for name in node.names if "tbm" in name.name
    ]
    found = {".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts) for file in imported_files(text)}
    assert {name.removesuffix(".__init__") for name in found} == ours
    assert all(file.exists() for file in imported_files(text))
    by_name = [name.name for node in nodes if getattr(node, "module", "") == "tbmslam.kernels" for name in node.names]
    assert not any((PACKAGE / "kernels" / f"{name}.py").exists() for name in by_name)
