"""The experiments of the paper that this project follows, on maps whose true relative poses are known."""
