"""Faults that are tried on the real programs, one family a file; each has its list `CASES`."""
