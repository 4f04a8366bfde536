"""Laser scans, their sensor model, and the division of recordings into robots."""
