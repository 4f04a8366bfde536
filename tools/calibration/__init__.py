"""The confidence model: its fit to pairs of maps with known truth, and its calibration."""
