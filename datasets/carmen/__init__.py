"""Logs of CARMEN."""
