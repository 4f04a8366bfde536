"""Where readings come from: bags, logs and simulated worlds, one module a format."""
