"""Point clouds, cut at the height of a laser into scans."""
