import numpy as np
import pytest

from tbmslam.kernels.adjustment.pose_systems import LineSystem, MotionSystem, PoseSystem, times
from tbmslam.kernels.adjustment.two_levels import conjugate_gradients, precondition, preconditioner_of
from tbmslam.optimisation.pose_graph import coarse_space_of

COUNT = 30


@pytest.fixture
def poses(generator):
    return np.column_stack((generator.uniform(-5.0, 5.0, (COUNT, 2)), generator.uniform(-3.0, 3.0, COUNT)))


@pytest.fixture
def system(generator):
    """Motions from each pose to the next and between some others, and lines that many poses saw."""
    ends = np.array([*((k, k + 1) for k in range(COUNT - 1)), (3, 17), (25, 2), (9, 8), (4, 4)])
    own, across = np.tile(np.eye(3), (COUNT, 1, 1)), np.zeros((len(ends), 3, 3))
    for e, (source, target) in enumerate(ends):
        left, right = generator.normal(size=(2, 3, 3))
        own[source] += left.T @ left
        own[target] += right.T @ right
        across[e] = left.T @ right if source != target else 0.0
    couplings, inverses, observers, begins = [], [], [], [0]
    for _ in range(12):
        slopes = generator.normal(size=(int(generator.integers(2, 9)), 4, 5))  # hits by pose and line
        curvature = 1e-3 * np.eye(2) + sum(one[:, 3:].T @ one[:, 3:] for one in slopes)
        inverse = np.linalg.inv(curvature)
        inverses.append([inverse[0, 0], inverse[0, 1], inverse[1, 1]])
        for one in slopes:
            observer = int(generator.integers(COUNT))
            own[observer] += one[:, :3].T @ one[:, :3]
            couplings.append(one[:, :3].T @ one[:, 3:])
            observers.append(observer)
        begins.append(len(observers))
    inverses.append([0.0, 0.0, 0.0])  # no line
    couplings.append(np.ones((3, 2)))
    lines = LineSystem(
        np.array(couplings), np.array(inverses), np.array([*observers, 0]), np.array([*begins, len(observers) + 1])
    )
    return PoseSystem(own, lines, MotionSystem(ends, across))


def dense(system):
    """Return the whole curvature (3 N, 3 N), of which the lines' part, and that of each pose and the next."""
    own, motions = np.zeros((3 * COUNT, 3 * COUNT)), np.zeros((3 * COUNT, 3 * COUNT))
    lines = np.zeros_like(own)
    for k in range(COUNT):
        own[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = system.own[k]
    for (source, target), across in zip(system.motions.ends, system.motions.across, strict=True):
        motions[3 * source : 3 * source + 3, 3 * target : 3 * target + 3] += across
        motions[3 * target : 3 * target + 3, 3 * source : 3 * source + 3] += across.T
    for line, (aa, ad, dd) in enumerate(system.lines.inverses):
        coupling = np.zeros((3 * COUNT, 2))
        for o in range(system.lines.begins[line], system.lines.begins[line + 1]):
            k = system.lines.observers[o]
            coupling[3 * k : 3 * k + 3] += system.lines.couplings[o]
        lines -= coupling @ np.array([[aa, ad], [ad, dd]]) @ coupling.T
    return own + motions + lines, own + motions, lines


def test_the_product_is_that_of_the_whole_curvature(system, generator):
    changes = generator.normal(size=(COUNT, 3))
    whole, _, _ = dense(system)
    np.testing.assert_allclose(times(system, changes).ravel(), whole @ changes.ravel(), atol=1e-9)


@pytest.mark.parametrize("precision", [1e-3, 1e-9])
def test_conjugate_gradients_solve_the_whole_curvature(system, poses, generator, precision):
    whole, coarse = dense(system)[0], coarse_space_of([0, COUNT])
    gradient, factors = generator.normal(size=(COUNT, 3)), preconditioner_of(system, poses, coarse)
    changes = conjugate_gradients(system, factors, coarse, gradient, precision, 200)
    left = np.linalg.norm(gradient.ravel() - whole @ changes.ravel()) / np.linalg.norm(gradient)
    assert 1e-3 * precision < left <= precision
    if precision < 1e-6:
        np.testing.assert_allclose(changes.ravel(), np.linalg.solve(whole, gradient.ravel()), rtol=1e-5, atol=1e-7)


def test_conjugate_gradients_stop_after_so_many_steps(system, poses, generator):
    coarse, gradient = coarse_space_of([0, COUNT]), generator.normal(size=(COUNT, 3))
    factors = preconditioner_of(system, poses, coarse)
    assert (conjugate_gradients(system, factors, coarse, gradient, 1e-9, 0) == 0.0).all()
    assert (conjugate_gradients(system, factors, coarse, 0.0 * gradient, 1e-9, 200) == 0.0).all()


@pytest.mark.parametrize("ends", [[0, COUNT], [0, 1, 12, COUNT]])
def test_the_preconditioner_adds_the_exact_solutions_of_both_levels(system, poses, generator, ends):
    coarse, forces = coarse_space_of(ends), generator.normal(size=(COUNT, 3))
    whole, motions, lines = dense(system)
    block = np.arange(3 * COUNT) // 3
    apart = np.abs(block[:, None] - block)
    seen_alone = np.zeros_like(lines)  # a pose that saw a line twice counts as two that did
    for line, (aa, ad, dd) in enumerate(system.lines.inverses):
        for o in range(system.lines.begins[line], system.lines.begins[line + 1]):
            at = slice(3 * system.lines.observers[o], 3 * system.lines.observers[o] + 3)
            b = system.lines.couplings[o]
            seen_alone[at, at] -= b @ np.array([[aa, ad], [ad, dd]]) @ b.T
    near = np.where(apart <= 1, motions, 0.0) + seen_alone
    follow = np.zeros((3 * COUNT, 3 * len(coarse.knots)))
    for k in range(COUNT):
        for knot, share in zip(coarse.sides[k], coarse.shares[k], strict=True):
            dx, dy = poses[k, :2] - poses[coarse.knots[knot], :2]
            rigid = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
            follow[3 * k : 3 * k + 3, 3 * knot : 3 * knot + 3] += share * rigid
    expected = np.linalg.solve(near, forces.ravel())
    expected += follow @ np.linalg.solve(follow.T @ whole @ follow, follow.T @ forces.ravel())
    found = precondition(preconditioner_of(system, poses, coarse), coarse, forces)
    np.testing.assert_allclose(found.ravel(), expected, atol=1e-7 * np.abs(expected).max())
