"""Cleaning, counting and clocks of recorded scans."""
