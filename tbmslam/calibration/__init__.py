"""Checks of the laser's stated mount, ranges and angles against odometry, scans and walls."""
