"""Pairs and sets of maps with known poses."""
