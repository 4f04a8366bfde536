import numpy as np
import pytest

from merging.baselines.cell_states import CellStates
from merging.baselines.saeedi import VoronoiDiagram
from tbmslam.belief.grid import GridGeometry, TbmGrid


def test_the_diagram_of_a_corridor_is_its_middle_line_with_width_and_certainty():
    masses = np.tile(np.array([0.0, 0.6, 0.0, 0.4], dtype=np.float32), (25, 100, 1))
    masses[[0, -1]] = (0.0, 0.0, 1.0, 0.0)
    grid = TbmGrid(GridGeometry(0.1, -5.0, 2.0, 25, 100), masses)
    diagram = VoronoiDiagram.of(grid, CellStates.of(grid), 0.5)
    assert len(diagram.points) >= 100
    assert diagram.points.imag == pytest.approx(np.full(len(diagram.points), 3.25), abs=0.11)
    assert diagram.clearances_m == pytest.approx(np.full(len(diagram.points), 1.2), abs=0.11)
    assert diagram.probabilities == pytest.approx(np.full(len(diagram.points), 0.8))
    assert [len(points) for points, _ in diagram.channels(0j, 0.0)] == [0, 0, len(diagram.points), 0]
