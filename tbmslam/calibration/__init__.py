"""How the laser is mounted, and what its ranges and angles are off by."""
