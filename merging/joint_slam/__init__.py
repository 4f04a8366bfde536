"""The drives of several robots optimised together."""
