"""Surfels: their statistics, search and alignment."""
