"""Search for bytes that a border does not survive, guided by the lines of code that they reach.

python tests/fuzzing/fuzz.py npz --seconds 600      needs `pip install -e .[fuzz]` (atheris: Linux and macOS)

Bytes that break something are written beside this file as found-*; mend the code and move them to corpus/BORDER/.
"""

import argparse
import logging
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import atheris  # noqa: E402 - the path comes first, so that the checkout's own tests are found

_OURS = ["tbmslam", "datasets", "merging", "rosbags", "mcap", "yaml"]
# Numba cannot compile what atheris has put its counters into.
_COMPILED = [f"tbmslam.kernels.{path.stem}" for path in (ROOT / "tbmslam" / "kernels").glob("[a-z]*.py")]

with atheris.instrument_imports(include=_OURS, exclude=_COMPILED):
    from tests.fuzzing.borders import BORDERS, CORPUS, cross


class _Unheard(logging.Handler):
    """Words warnings, as what words them may fail, too, and says nothing: a terminal takes longer than a reader."""

    def emit(self, record: logging.LogRecord) -> None:
        record.getMessage()


def main() -> None:
    """Fuzz until the time is over or something is found."""
    grammar = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    grammar.add_argument("border", choices=BORDERS)
    grammar.add_argument("--seconds", type=int, default=60)
    args = grammar.parse_args()
    logging.getLogger().addHandler(_Unheard())
    with tempfile.TemporaryDirectory() as seeds:
        healthy = BORDERS[args.border].seeds()
        for number, seed in enumerate(healthy):
            (Path(seeds) / str(number)).write_bytes(seed)
        found = Path(__file__).parent / f"found-{args.border}-"
        options = [
            f"-max_total_time={args.seconds}",
            "-rss_limit_mb=3000",
            "-timeout=20",
            f"-max_len={max(1024, 2 * max(map(len, healthy)))}",
            f"-artifact_prefix={found}",
        ]
        known = CORPUS / args.border
        folders = [seeds, *([str(known)] if known.is_dir() else [])]
        atheris.Setup([sys.argv[0], *options, *folders], lambda content: cross(args.border, content))
        atheris.Fuzz()


if __name__ == "__main__":
    main()
