"""The programs as commands of an installed tbmslam."""

from tools.command_line.interruption import hear_interruption


def build_maps() -> int:
    """Run tbm-build-maps."""
    hear_interruption("build_maps")
    from tools.build_maps import main  # noqa: PLC0415 - each command loads its own program

    return main()


def merge() -> int:
    """Run tbm-merge."""
    hear_interruption("merge")
    from tools.merge import main  # noqa: PLC0415

    return main()


def evaluate() -> int:
    """Run tbm-evaluate."""
    hear_interruption("evaluate")
    from tools.evaluate import main  # noqa: PLC0415

    return main()


def benchmark() -> int:
    """Run tbm-benchmark."""
    hear_interruption("benchmark")
    from tools.benchmark import main  # noqa: PLC0415

    return main()


def make_world() -> int:
    """Run tbm-make-world."""
    hear_interruption("make_world")
    from tools.make_world import main  # noqa: PLC0415

    return main()


def download() -> int:
    """Run tbm-download."""
    hear_interruption("download")
    from tools.download import main  # noqa: PLC0415

    return main()
