"""Trackers of the related work: vinySLAM, and a particle filter after FastSLAM. The default preset uses neither."""
