"""Tracking of the robot: each scan is registered to earlier scans."""
