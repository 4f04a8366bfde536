import pytest

from tests.end_to_end.programs import build, merge_maps, simulate


@pytest.fixture(scope="session")
def office(tmp_path_factory):
    """Three robots, 50 m each, in an office with the default laser (1040 beams, 20 Hz), their maps and the merge."""
    root = tmp_path_factory.mktemp("office")
    bags = simulate(root / "bags", "--world", "office", "--seed", 1, "--robots", 3, "--length", 50)
    maps = build(root / "maps", *(bags / f"robot_{k}.bag" for k in range(3)), "--separate", "--no-truth")
    merge_maps(root / "merged", *(maps / f"robot_{k}" for k in range(3)))
    return root


@pytest.fixture(scope="session")
def flat(tmp_path_factory):
    """Two robots in a flat with a small laser: bags only, quick to map."""
    bags = tmp_path_factory.mktemp("flat")
    small = ("--beams", 361, "--rate", 8, "--length", 45, "--overlap", 0.6)
    return simulate(bags, "--world", "apartment", "--seed", 3, "--robots", 2, *small)


@pytest.fixture(scope="session")
def flat_maps(flat, tmp_path_factory):
    """The flat's two robots mapped."""
    return build(tmp_path_factory.mktemp("flat") / "maps", flat / "robot_0.bag", flat / "robot_1.bag", "--separate")


@pytest.fixture(scope="session")
def flat_merged(flat_maps, tmp_path_factory):
    """The flat's two maps merged."""
    folder = tmp_path_factory.mktemp("flat") / "merged"
    merge_maps(folder, flat_maps / "robot_0", flat_maps / "robot_1")
    return folder
