"""Which code this is: results are kept, and shared between machines, only under the same."""

import functools
import hashlib
import importlib
from pathlib import Path


@functools.cache
def code_digest(*packages: str) -> str:
    """Return a digest of the Python sources of packages, by import name."""
    digest = hashlib.sha256()
    for package in packages:
        paths = list(importlib.import_module(package).__path__)
        for folder in map(Path, paths):
            for source in sorted(folder.rglob("*.py")):
                digest.update(source.relative_to(folder).as_posix().encode() + b"\0")
                digest.update(source.read_bytes() + b"\0")
    return digest.hexdigest()
