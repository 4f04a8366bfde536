"""`build_maps` as a shell calls it, and what it writes down about a robot."""

import json

import pytest

from tools import build_maps

QUICK = ("--no-truth",)


def run(*arguments):
    return build_maps.main([str(argument) for argument in arguments])


def run_record(folder):
    """Return the content of run.json, which must be JSON in the strict sense: no Infinity and no NaN."""
    return json.loads((folder / "run.json").read_text(), parse_constant=pytest.fail)
