import pytest

from datasets.errors import DatasetError
from datasets.known_recordings import known_recording, known_recordings


def test_each_says_where_it_is_and_what_it_may_be_used_for():
    known = known_recordings()
    assert {"stata/2011-01-24-06-18-27", "freiburg/intel"} <= known.keys()
    addresses = [address for recording in known.values() for address in recording.addresses]
    assert len(set(addresses)) == len(addresses)
    for recording in known.values():
        assert all(address.startswith("http") for address in recording.addresses)
        assert all((recording.license, recording.citation, recording.page, recording.about))


def test_the_profile_goes_with_it():
    assert known_recording("stata/2011-01-24-06-18-27").options == "--profile stata"


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("stata/2011-01-24-06-18-72", "did you mean stata/2011-01-24"),
        ("intel", "freiburg/intel"),
        ("x", "--list"),
    ],
)
def test_an_unknown_name(name, meant):
    with pytest.raises(DatasetError, match=rf"there is no known recording '{name}': .*{meant}"):
        known_recording(name)
