"""The names of a package that are loaded at their first use."""

import importlib
import sys
from collections.abc import Callable, Mapping


def lazy_names(package: str, homes: Mapping[str, str]) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package.

    A program that needs only an error's class, or only the parameters, then loads no compiled code.

    Parameters
    ----------
    package
        Name of the package.
    homes
        The module of each name. A name that begins with a dot is relative to the package.
    """

    def load(name: str) -> object:
        if name in homes:
            return getattr(importlib.import_module(homes[name], package), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes})

    return load, names
