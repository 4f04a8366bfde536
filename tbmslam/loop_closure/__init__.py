"""Loops: places seen again are found, verified, and bend the drive so that they coincide."""
