import os

from tbmslam.special_file import is_device_or_pipe, why_unreadable


def test_devices_pipes_and_links_to_them_are_detected(tmp_path):
    file, pipe, link, broken = (tmp_path / name for name in ("file", "pipe", "link", "broken"))
    file.write_text("x")
    os.mkfifo(pipe)
    link.symlink_to("/dev/null")
    broken.symlink_to(tmp_path / "nothing")
    assert [is_device_or_pipe(path) for path in (pipe, link)] == [True, True]
    assert not any(is_device_or_pipe(path) for path in (file, tmp_path, broken, tmp_path / "nothing"))


def test_the_reason_of_an_unreadable_file_is_given(tmp_path):
    file, pipe, empty, link = (tmp_path / name for name in ("file", "pipe", "empty", "link"))
    file.write_text("x")
    empty.touch()
    os.mkfifo(pipe)
    link.symlink_to(empty)
    assert [why_unreadable(path) for path in (file, tmp_path, tmp_path / "nothing")] == [None] * 3
    assert why_unreadable(pipe) == "is a device or a pipe"
    assert [why_unreadable(path) for path in (empty, link)] == ["is empty"] * 2
