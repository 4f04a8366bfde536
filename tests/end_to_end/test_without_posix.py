"""What Windows has not is not needed: the programs in a process without the modules and calls of POSIX alone."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WITHOUT = """
import errno, fcntl, os, signal, stat, sys
from functools import cache
import filelock  # which has its own lock for Windows

def fsync(descriptor, real=os.fsync, flags=fcntl.fcntl):
    is_written = flags(descriptor, fcntl.F_GETFL) & (os.O_WRONLY | os.O_RDWR)
    if not is_written and not stat.S_ISDIR(os.fstat(descriptor).st_mode):  # folders are flushed under POSIX only
        raise OSError(errno.EBADF, "Bad file descriptor")  # Windows flushes only what may be written
    real(descriptor)

os.fsync = fsync
for name in ("resource", "fcntl", "pwd", "grp", "termios"):
    sys.modules[name] = None
for module, names in (
    (os, "fork killpg getuid geteuid sysconf sched_getaffinity statvfs"),
    (signal, "SIGKILL SIGHUP SIGALRM SIGQUIT setitimer pthread_sigmask"),
):
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
"""
DRIVE = ["--world", "apartment", "--robots", "2", "--length", "12", "--overlap", "0.8", "--beams", "181", "--rate", "5"]


@pytest.mark.skipif(os.name != "posix", reason="there is nothing to take away")
def test_each_step_from_a_simulated_drive_to_a_merged_map(tmp_path):
    lines = [
        ["world", *DRIVE, "-o", "bags"],
        ["world", *DRIVE, "--format", "mcap", "-o", "bags2"],
        ["map", "bags", "--separate", "-o", "maps"],
        ["merge", "maps", "-o", "merged"],
        ["convert", "merged", "map.yaml"],
        ["edit", "merged", "--rotate", "10", "-o", "edited"],
        ["evaluate", "trajectory", "maps/robot_0/trajectory.tum", "--truth", "bags/robot_0.truth.tum"],
        ["config"],
        ["download", "--list"],
        ["benchmark", "slam", "bags/robot_0.bag", "--json", "figures.json"],
        *(["benchmark", name, "--help"] for name in ("align", "merge", "fleet", "split", "perturb", "strangers")),
    ]
    script = (
        f"{WITHOUT}\n\nif __name__ == '__main__':\n"
        "    from tbmslam.commands import main\n"
        "    from tools.benchmarks import slam\n"
        "    slam.in_fresh_process = cache(slam.in_fresh_process)  # two equal runs are one\n"
        f"    for line in {lines!r}:\n"
        "        try:\n"
        "            code = main(line)\n"
        "        except SystemExit as left:\n"
        "            code = left.code\n"
        "        assert code == 0, line\n"
    )
    (tmp_path / "steps.py").write_text(script, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "steps.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "merged" / "map.npz").is_file()
