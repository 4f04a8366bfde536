"""Whole grids: fusion, resampling and walls."""
