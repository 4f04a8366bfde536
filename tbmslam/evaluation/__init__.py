"""How far maps and trajectories are from the truth."""
