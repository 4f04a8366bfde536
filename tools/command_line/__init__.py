"""Common parts of the command lines of all programs."""
