"""Scores of maps and trajectories against a truth."""
