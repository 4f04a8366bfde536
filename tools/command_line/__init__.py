"""What all programs share on the command line."""
