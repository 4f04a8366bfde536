"""Simulated robots: their laser, wheels, drives and faults."""
