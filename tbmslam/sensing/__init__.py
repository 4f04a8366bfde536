"""What a laser measures: scans, their model, and recordings as several robots."""
