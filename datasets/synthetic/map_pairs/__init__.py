"""Pairs and sets of maps whose relative poses are known."""
