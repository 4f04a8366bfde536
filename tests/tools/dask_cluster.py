"""A real Dask scheduler and workers, each in a process of its own on loopback."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class DaskCluster:
    """A scheduler and some workers; use it in a `with` block."""

    def __init__(self, folder, workers):
        self.folder, self.count = folder, workers
        self.started, self.workers = [], []

    def __enter__(self):
        try:
            return self._begin()
        except BaseException:
            self.__exit__()
            raise

    def __exit__(self, *_):
        for process in reversed(self.started):
            process.kill()
            process.wait()

    def _begin(self):
        listing = self.folder / "scheduler.json"
        self._start(
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--no-dashboard",
            "--no-show",
            "--scheduler-file",
            listing,
        )
        self._wait(lambda: _is_written(listing))
        self.address = json.loads(listing.read_text())["address"]
        for _ in range(self.count):
            self.start_worker()
        return self

    def start_worker(self):
        self.workers.append(
            self._start(
                "worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1",
                "--local-directory", self.folder,
            )
        )  # fmt: skip

    def wait_until_busy(self):
        """Return when work has arrived at the workers."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            self._wait(lambda: any(client.processing().values()))

    def _start(self, what, *words):
        command = [sys.executable, "-m", "dask", what, *map(str, words)]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        self.started.append(
            subprocess.Popen(command, cwd=self.folder, env=environment, stderr=subprocess.DEVNULL)  # noqa: S603
        )
        return self.started[-1]

    def _wait(self, is_so, seconds=60):
        end = time.monotonic() + seconds
        while not is_so():
            assert time.monotonic() < end
            time.sleep(0.05)


def _is_written(listing):
    """Return whether the scheduler has not only opened this file but filled it."""
    try:
        return "address" in json.loads(listing.read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return False
