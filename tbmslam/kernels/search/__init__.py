"""Exhaustive searches for poses and places."""
