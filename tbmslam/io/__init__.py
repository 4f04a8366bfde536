"""Maps and trajectories in files: ours, and those of other programs."""
