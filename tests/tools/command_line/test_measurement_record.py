import importlib.metadata
import json
import platform
import subprocess

import pytest

from tools.command_line.measurement_record import commit_of_code, describe_machine, write_tables
from tools.command_line.text_table import ResultTable


def test_processor_and_versions_are_named():
    machine = describe_machine()
    assert machine["python"] == platform.python_version()
    assert machine["cores"] >= 1
    assert machine["processor"]
    assert {"numpy", "numba", "tbmslam"} <= set(machine)


def test_a_clone_that_is_not_installed_has_a_machine(monkeypatch):
    def missing(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", missing)
    assert "tbmslam" not in describe_machine()


def test_tables_are_written_with_commit_date_and_machine(tmp_path):
    path = tmp_path / "tables.json"
    write_tables(
        path,
        {"cores": 2, "system": "Linux 6"},
        {"drives": ResultTable(("drive", "m"), [["aces", "0.03"]]), "seeds": ResultTable(("drive",), [])},
    )
    record = json.loads(path.read_text())
    assert record["machine"] == {"cores": 2}
    assert record["tables"] == {"drives": {"columns": ["drive", "m"], "rows": [["aces", "0.03"]]}}
    assert len(record["date"]) == len("2026-11-23")
    assert "commit" in record


def test_without_a_path_nothing_is_written():
    write_tables(None, {}, {})


def git(folder, *words):
    subprocess.run(["git", "-c", "user.name=x", "-c", "user.email=x@x", *words], cwd=folder, check=True)  # noqa: S603, S607 - fixed words


@pytest.fixture
def checkout(tmp_path):
    (tmp_path / "tools").mkdir()
    (tmp_path / "docs").mkdir()
    (tmp_path / "tools" / "a.py").write_text("")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "x")
    return tmp_path


def test_the_commit_is_marked_if_code_was_changed(checkout):
    clean = commit_of_code(checkout)
    assert len(clean) >= 7
    (checkout / "docs" / "slam.json").write_text("{}")
    assert commit_of_code(checkout) == clean
    (checkout / "tools" / "a.py").write_text("1")
    assert commit_of_code(checkout) == f"{clean}-changed"


def test_outside_a_checkout_there_is_no_commit(tmp_path, monkeypatch):
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert commit_of_code(tmp_path) is None
