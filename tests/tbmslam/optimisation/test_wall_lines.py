"""The lines that stretches see."""

import numpy as np

from tbmslam.kernels.adjustment.wall_pieces import StretchHits
from tbmslam.optimisation.bundle_adjustment import AdjustmentConfig, WallLines


def test_pieces_that_are_no_line_do_not_count(generator):
    """A wall seen from two poses, and lone hits on clutter which no line fits."""
    config = AdjustmentConfig()
    along = np.linspace(-3.0, 3.0, 600)
    wall = np.column_stack((along, np.full(600, 1.5) + generator.normal(0.0, 0.005, 600), np.full(600, -np.pi / 2)))
    clutter = np.column_stack((generator.uniform(-9.0, 9.0, (300, 2)), generator.uniform(-np.pi, np.pi, 300)))
    hits = np.vstack((wall, clutter)).astype(np.float32)
    loose = np.zeros((0, 2), dtype=np.float32)
    both = StretchHits(np.vstack((hits, hits)), np.array([0, 900, 1800]), loose, np.zeros(3, dtype=np.int64))
    lines = WallLines(both, 1, np.zeros((2, 3)), 0, config)
    assert 6.0 / config.cell - 1 <= len(lines.lines) < 0.2 * len(hits)
    assert lines.lines[:, 4].min() > 0.1 * config.cell
    assert (np.abs(lines.lines[:, 1] - 1.5) < 0.02).all()
    assert len(lines.begins) == len(lines.lines) + 1
    assert lines.begins[-1] == len(lines.moments) == len(lines.observers)
