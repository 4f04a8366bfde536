"""The programs as commands of an installed tbmslam."""


def build_maps() -> int:
    """Run tbm-build-maps."""
    from tools.build_maps import main  # noqa: PLC0415 - each command loads its own program

    return main()


def merge() -> int:
    """Run tbm-merge."""
    from tools.merge import main  # noqa: PLC0415

    return main()


def evaluate() -> int:
    """Run tbm-evaluate."""
    from tools.evaluate import main  # noqa: PLC0415

    return main()


def benchmark() -> int:
    """Run tbm-benchmark."""
    from tools.benchmark import main  # noqa: PLC0415

    return main()


def make_world() -> int:
    """Run tbm-make-world."""
    from tools.make_world import main  # noqa: PLC0415

    return main()


def download() -> int:
    """Run tbm-download."""
    from tools.download import main  # noqa: PLC0415

    return main()
