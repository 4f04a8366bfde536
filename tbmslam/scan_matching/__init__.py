"""Where was this scan taken? One matcher a file, all behind one interface."""
