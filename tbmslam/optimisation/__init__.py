"""Drives and walls adjusted to each other at once, after loops are closed."""
