"""A bag as most robots record it, and how it is read."""

from pathlib import Path

from datasets import Recording, RecordingOptions, open_recording
from datasets.odometry.se3 import SE3
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import Reading

STAMPS = [100.03 + 0.1 * k for k in range(60)]
ROLLED_OVER = SE3(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def ordinary(script, stamps=STAMPS):
    """Odometry at 20 Hz, scans at 10 Hz, the laser 0.3 m ahead."""
    script.tf(100.0, "base_link", "laser", SE2(0.3, 0.0, 0.0), topic="/tf_static")
    script.drive(100.0, 106.5)
    for k, stamp in enumerate(stamps):
        script.scan(stamp, [1.0, 2.0, 3.0 + 0.01 * k], bag_time=stamp + 0.02)
    return script.in_time_order()


def assert_close(pose: SE2 | None, expected: SE2, tolerance: float = 1e-3) -> None:
    assert pose is not None
    error = expected.inverse() @ pose
    assert max(map(abs, error)) < tolerance, f"{pose} instead of {expected}"


def read(path: Path, **options: object) -> tuple[list[Reading], Recording]:
    recording = open_recording([path], RecordingOptions(**options))
    return list(recording), recording
