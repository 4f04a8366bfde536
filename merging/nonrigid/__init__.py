"""Maps that fit nowhere rigidly: one of two is deformed."""
