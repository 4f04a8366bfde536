"""The report of a program: one page with maps in layers, figures, warnings, and the parameters of the run."""
