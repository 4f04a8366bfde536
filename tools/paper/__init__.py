"""The paper's experiments on maps with known poses, and their report, for `tools/reproduce_paper.py`."""
