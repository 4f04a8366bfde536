import pytest

from tools.output_folder import OutputError, output_folder


def test_two_runs_never_write_into_one_folder(tmp_path):
    folder = tmp_path / "out"
    with output_folder(folder):
        (folder / "result").touch()
        expected = pytest.raises(
            OutputError, match=r"out: another run is writing there: wait for it, or choose another"
        )
        with expected, output_folder(folder):
            pytest.fail("two at a time")
    with output_folder(folder):
        pass
    assert [path.name for path in folder.iterdir()] == ["result"]


def test_a_lock_left_by_a_run_that_was_killed_does_not_matter(tmp_path):
    (tmp_path / ".tbmslam.lock").touch()
    with output_folder(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_what_was_made_in_vain_is_removed(tmp_path):
    with pytest.raises(ZeroDivisionError), output_folder(tmp_path / "a" / "b"):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_noticed_at_once(tmp_path):
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        expected = pytest.raises(OutputError, match=r"cannot be written into \(.+\): choose another folder with -o")
        with expected, output_folder(folder):
            pytest.fail("this would be too late")
