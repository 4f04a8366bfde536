"""Following the robot: each scan is placed in what was learnt from earlier ones."""
