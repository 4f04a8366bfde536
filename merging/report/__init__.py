"""The report of a merge, as JSON and as a page."""
