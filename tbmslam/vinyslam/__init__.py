"""The front end of vinySLAM: a scan matched to a grid of masses."""
