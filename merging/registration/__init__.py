"""Hypotheses of the relative pose of two maps."""
