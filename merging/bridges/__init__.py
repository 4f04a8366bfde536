"""Alignments that alone join two groups of maps, and their verification."""
