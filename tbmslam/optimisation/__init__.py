"""Joint optimisation of poses and walls after loop closure."""
