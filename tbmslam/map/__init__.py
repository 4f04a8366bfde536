"""One robot's map: keyframes, walls and drives."""
