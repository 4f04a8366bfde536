"""Scans as a recording holds them: cleaned, counted, with their clock."""
