"""Loop closure: revisited places are found and verified, and the drive is corrected."""
