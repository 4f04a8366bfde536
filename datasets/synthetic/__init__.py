"""Simulated buildings, robots and measurements: recordings with known truth."""
