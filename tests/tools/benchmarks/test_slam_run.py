import gc

import numpy as np

from tbmslam.configuration.slam_config import preset
from tbmslam.geometry.se2 import SE2
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tools.benchmarks import slam_run as module


def test_a_loop_is_closed_and_only_the_first_scans_are_read(monkeypatch):
    scan = LaserScan(0.0, -1.5, 0.05, 0.1, 20.0, np.full(60, 2.0))
    read, made = [], []

    def readings():
        for number in range(100):
            read.append(number)
            yield Reading(scan, SE2.identity())

    class Noted(module.TimedSlam):
        def finish(self, *args):
            made.append(super().finish(*args))
            return made[-1]

    monkeypatch.setattr(module, "TimedSlam", Noted)
    module.warm_up(preset("default"), readings())
    gc.unfreeze()
    assert len(read) == module.WARM_UP_SCANS
    assert [len(tbm_map.drives[0].closures) > 0 for tbm_map in made] == [False, True]
