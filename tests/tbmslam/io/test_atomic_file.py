import os

import pytest

from tbmslam.io.atomic_file import FileNotWrittenError, replacing, write_bytes, write_text


def names_in(folder):
    return [path.name for path in folder.iterdir()]


def write_and_fail(path):
    with replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise KeyError


def test_parents_are_made_and_nothing_else_is_left(tmp_path):
    write_text(tmp_path / "a" / "b" / "text.txt", "für\n")
    assert (tmp_path / "a" / "b" / "text.txt").read_bytes() == "für\n".encode()
    assert names_in(tmp_path / "a" / "b") == ["text.txt"]


def test_a_new_file_takes_the_place_of_the_old_one_only_at_the_end(tmp_path):
    path = tmp_path / "map.npz"
    write_bytes(path, b"old")
    with replacing(path) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".npz"
        temporary.write_bytes(b"new")
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert names_in(tmp_path) == ["map.npz"]


def test_a_failure_keeps_the_old_file(tmp_path):
    path = tmp_path / "map.npz"
    write_bytes(path, b"old")
    with pytest.raises(KeyError):
        write_and_fail(path)
    assert path.read_bytes() == b"old"
    assert names_in(tmp_path) == ["map.npz"]


def test_a_file_has_the_usual_permissions(tmp_path):
    (tmp_path / "usual").write_bytes(b"")
    write_bytes(tmp_path / "ours", b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(FileNotWrittenError, match=r"inside: cannot be written \(.+\): choose another place"):
        write_bytes(tmp_path / "file" / "inside", b"")
    (tmp_path / "folder").mkdir()
    with pytest.raises(FileNotWrittenError, match="folder: cannot be written"):
        write_bytes(tmp_path / "folder", b"")


def test_the_remains_of_a_killed_writer_are_removed_by_the_next_file(tmp_path):
    target, others = tmp_path / "map[1].npz", [tmp_path / ".0123abcd.map.npz", tmp_path / ".notes.map[1].npz"]
    left = tmp_path / ".0123abcd.map[1].npz"
    for path in (left, *others):
        path.write_bytes(b"half")
    write_bytes(target, b"new")
    assert target.read_bytes() == b"new"
    assert sorted(tmp_path.iterdir()) == sorted([target, *others])


def test_what_fails_after_the_replacement_is_no_error(tmp_path, monkeypatch):
    def fail(*_):
        raise OSError("no such luck")

    monkeypatch.setattr("tbmslam.io.atomic_file._flush_folder", fail)
    (tmp_path / ".0123abcd.a").write_bytes(b"half")
    write_bytes(tmp_path / "a", b"new")
    assert names_in(tmp_path) == ["a"]
    monkeypatch.setattr("tbmslam.io.atomic_file._remove_leftovers", fail)
    write_bytes(tmp_path / "a", b"newer")
    assert (tmp_path / "a").read_bytes() == b"newer"


def test_names_that_are_no_text_are_written_out(tmp_path):
    write_text(tmp_path / "a.txt", "drive \udcff \u00fc")
    assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "drive \\udcff \u00fc"


@pytest.mark.parametrize("name", ["", ".", "/"])
def test_a_name_that_is_none_is_refused(name):
    with pytest.raises(FileNotWrittenError, match="is no file name: give a file name"):
        write_text(name, "new")


def test_what_is_no_file_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/null")
    for place in (tmp_path / "pipe", tmp_path / "link", "/dev/null", "/dev/stdout"):
        with pytest.raises(FileNotWrittenError, match="is a device or a pipe: give the name of a file"):
            write_text(place, "new")
    assert (tmp_path / "pipe").is_fifo()
    assert (tmp_path / "link").is_symlink()
