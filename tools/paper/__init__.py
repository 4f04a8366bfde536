"""What `tools/reproduce_paper.py` runs and draws: the paper's experiments on maps whose poses are known."""
