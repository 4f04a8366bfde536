"""The rows of docs/warnings.md, which explain the warnings of the programs."""

import re

from tests.processes import ROOT

_LINES = (ROOT / "docs" / "warnings.md").read_text(encoding="utf-8").splitlines()
_WORDS = [words for line in _LINES if line.startswith("| ") for words in line[2:].split(" | ")[0].split("; ")]
_PATTERNS = [re.escape(words).replace(re.escape("..."), ".*") for words in _WORDS if words not in ("warning", "---")]


def is_explained(warning: str) -> bool:
    """Return whether a row names a warning, with `...` for what differs, and `;` between the warnings of a row."""
    return any(re.search(pattern, warning) for pattern in _PATTERNS)
