"""Errors of maps and trajectories against the truth."""
