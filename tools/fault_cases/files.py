"""Faults of files: while results are written, and in maps that are to be merged."""

from tools.fault_cases import hostile_maps, writing

CASES = (*writing.CASES, *hostile_maps.CASES)
