"""Poses and trajectories in the plane."""
