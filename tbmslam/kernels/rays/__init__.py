"""Beams through grids."""
