"""The graph of many maps: consistent groups, and the pose of each map in its group."""
