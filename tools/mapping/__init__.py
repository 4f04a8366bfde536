"""What `tools/build_maps.py` runs: robots planned from recordings, and mapped here, in processes or on a cluster."""
