"""One self-contained page that shows what a program made: maps with layers, figures, warnings and how it was run."""
