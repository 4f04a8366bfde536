"""The tracker of the related work, vinySLAM; the default preset does not use it."""
