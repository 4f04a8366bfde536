"""`build_maps` as a shell calls it, and what it writes down about a robot."""

import json

from tools import build_maps

QUICK = ("--no-truth",)


def run(*arguments):
    return build_maps.main([str(argument) for argument in arguments])


def run_record(folder):
    return json.loads((folder / "run.json").read_text())
