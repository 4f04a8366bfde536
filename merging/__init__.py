"""Many maps whose relative poses nobody knows become one."""
