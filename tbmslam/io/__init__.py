"""Files of maps and trajectories, also in formats of other programs."""
