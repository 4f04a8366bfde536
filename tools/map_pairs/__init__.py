"""Files of map pairs, and the floors they are cut from."""
