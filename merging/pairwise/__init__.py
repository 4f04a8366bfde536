"""Pairs of maps aligned, serially, in processes or on a cluster."""
