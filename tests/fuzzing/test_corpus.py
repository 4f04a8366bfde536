"""All that fuzzing ever found, and healthy bytes, brought over their border once more."""

import pytest

from tests.fuzzing.borders import BORDERS, CORPUS, cross

FOUND = sorted(path for path in CORPUS.glob("*/*") if path.is_file())


@pytest.mark.parametrize("path", FOUND, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_what_was_found_is_survived(path):
    assert cross(path.parent.name, path.read_bytes()) in {True, False}


@pytest.mark.parametrize("name", BORDERS)
def test_healthy_bytes_are_taken(name):
    seeds = BORDERS[name].seeds()
    assert seeds
    assert all(cross(name, seed) for seed in seeds)


@pytest.mark.parametrize(
    "name", sorted(set(BORDERS) - {"config", "tum", "relations", "records", "mcap", "database", "message"})
)
def test_no_bytes_are_refused(name):
    assert not cross(name, b"")
