"""Pairs of maps prepared and aligned."""
