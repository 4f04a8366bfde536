"""Broken bags, read without their index."""
