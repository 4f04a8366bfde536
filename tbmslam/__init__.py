"""One robot: laser scans and odometry become a map of belief masses."""
