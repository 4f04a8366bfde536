"""Aligned grids become one grid."""
