"""Planning and mapping of robots for `tools/build_maps.py`, in this process, in others or on a cluster."""
