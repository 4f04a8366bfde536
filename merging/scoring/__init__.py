"""How probable each hypothesis is."""
