"""Programs: command lines, reports and exit codes, without algorithms."""
