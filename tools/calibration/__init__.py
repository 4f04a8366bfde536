"""The fit of the confidence model."""
