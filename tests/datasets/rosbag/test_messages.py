import numpy as np
import pytest

from datasets import DatasetError, open_recording
from datasets.options import RecordingOptions


def test_names_cannot_steer_the_terminal(script, tmp_path, caplog):
    script.tf(100.0, "base_link", "las\x1b[2J\ner", topic="/tf_static").drive(100.0, 103.0)
    for k in range(20):
        script.scan(100.5 + 0.1 * k, np.full(181, 3.0), frame="las\x1b[2J\ner", step=0.01)
    recording = open_recording([script.in_time_order().write(tmp_path / "run.bag")])
    assert len(list(recording)) == 20
    with pytest.raises(DatasetError, match=r"las\\x1b\[2J\\ner"):
        open_recording([tmp_path / "run.bag"], RecordingOptions(laser_frame="other"))
    assert "\x1b" not in caplog.text
