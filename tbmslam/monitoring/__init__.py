"""Checks of a drive: incidents with their times, blocked beams, odometry and scans that disagree."""
