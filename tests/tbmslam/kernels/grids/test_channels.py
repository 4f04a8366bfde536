import numpy as np

from tbmslam.kernels.grids.channels import draw_channels
from tests.belief_rules import normalise


def test_each_image_is_its_formula():
    rng = np.random.default_rng(1)
    masses = rng.dirichlet(np.full(4, 0.5), size=(7, 5)).astype(np.float32)
    masses[0, 0], masses[1, 1] = (1, 0, 0, 0), (0, 0, 0, 1)
    images = np.full((4, 11, 9), 77, dtype=np.uint8)
    draw_channels(masses, 2, images)
    m = normalise(masses)[::-1]
    inner = images[:, 2:-2, 2:-2].astype(np.float64)
    assert np.all(inner[:, 5, 1] == 77)  # where nothing is known, nothing is drawn
    inner[:, 5, 1] = (127.5, 0, 0, 255)
    for image, value in zip(inner, (m[..., 1] + m[..., 3] / 2, m[..., 2], m[..., 1], m[..., 3]), strict=True):
        np.testing.assert_allclose(image, 255 * value, atol=0.5001)
    images[:, 2:-2, 2:-2] = 77
    assert np.all(images == 77)
