"""A particle filter over grids, after FastSLAM; no default preset uses it."""
