"""Hypotheses of where one map lies in another's frame."""
