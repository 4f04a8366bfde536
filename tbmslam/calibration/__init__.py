"""Checks of the recorded mount, ranges and angles of the laser, by odometry, scans and walls."""
