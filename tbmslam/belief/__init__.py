"""Masses of the Transferable Belief Model, and grids of them."""
