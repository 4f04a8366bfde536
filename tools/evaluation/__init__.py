"""What a run is worth against the truth."""
