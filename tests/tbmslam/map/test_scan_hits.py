import numpy as np

from tbmslam.geometry.se2 import SE2
from tbmslam.map.keyframes import Keyframes
from tbmslam.map.scan_hits import ScanHits
from tbmslam.sensing.laser_scan import LaserScan


def test_they_are_the_hits_of_each_scan(generator):
    ranges = generator.uniform(1.0, 6.0, (5, 50))
    ranges[generator.random((5, 50)) < 0.2] = np.nan
    scans = [LaserScan(float(k), -1.0, 0.04, 0.1, 10.0, row) for k, row in enumerate(ranges)]
    keyframes = Keyframes.from_scans(scans, *[[SE2.identity()] * 5] * 2)
    hits = ScanHits.of(keyframes, 5.0)
    assert len(hits) == 5
    for k, scan in enumerate(scans):
        own, expected = slice(hits.offsets[k], hits.offsets[k + 1]), scan.hits(5.0)
        np.testing.assert_allclose(hits.points[own], expected.points, atol=1e-5)
        np.testing.assert_allclose(hits.normals[own], expected.normals, atol=1e-4)
    assert hits.offsets[-1] == len(hits.points) == len(hits.normals)
