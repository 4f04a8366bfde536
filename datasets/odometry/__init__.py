"""Poses of the robot between scans."""
