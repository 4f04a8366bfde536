"""Many maps: which belong together, and where each lies."""
