import cv2
import numpy as np
import pytest

from tbmslam.io.png import encode_png


@pytest.mark.parametrize("shape", [(3, 5), (3, 5, 3)])
def test_a_picture_reads_back_as_it_was(shape):
    picture = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    read = cv2.imdecode(np.frombuffer(encode_png(picture), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, picture)
