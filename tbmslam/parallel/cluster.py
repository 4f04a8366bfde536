"""Work on other machines: an existing Dask cluster, reached by its scheduler's address."""

import functools
import hashlib
import importlib
import re
import secrets
import socket
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tbmslam.errors import TbmSlamError

_LAST_PORT = 65535
_LARGEST_GREETING = 1 << 20  # [bytes]
_ANSWER_S = 5.0  # time to wait for a scheduler, which answers within a second even over long distances [s]


class ClusterError(TbmSlamError):
    """The cluster cannot be reached, or a call failed there."""


class Cluster:
    """A connection to a Dask scheduler, such as `tcp://host:8786`, that waits up to `timeout_s` for a worker [s].

    If a worker dies, Dask runs its work on another one; the result is the same. Raises a `ClusterError` if Dask is not
    installed, no scheduler answers, or there are no workers.
    """

    def __init__(self, address: str, timeout_s: float = 15.0) -> None:
        try:
            from distributed import Client  # noqa: PLC0415 - an extra, and slow to load
        except ImportError:
            raise ClusterError("a cluster needs Dask: pip install 'tbmslam[cluster]'") from None
        place = re.fullmatch(r"((tcp|tls)://)?\[?([^/\s\[\]]+)\]?:(\d{1,5})", address)
        if place is None or int(place[4]) > _LAST_PORT:
            raise ClusterError(f"{address!r} is no address of a Dask scheduler: it must look like tcp://10.0.0.1:8786")
        self._address = address
        self._run = secrets.token_hex(4)
        try:
            if place[2] != "tls":  # a tls server answers only after a greeting
                _hear_scheduler(place[3], int(place[4]))
            self._client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except Exception as error:  # noqa: BLE001 - of what is no scheduler, or of certificates, Dask raises anything
            fact = str(error).partition("\n")[0] or type(error).__name__
            raise ClusterError(
                f"{address}: no Dask scheduler answers ({fact}): start one with `dask scheduler`, or use --workers"
            ) from None
        try:
            self._client.wait_for_workers(1, timeout=timeout_s)
        except TimeoutError:
            self._client.close()
            raise ClusterError(f"{address}: has no workers: start some with `dask worker {address}`") from None

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the connection and cancel unfinished work."""
        self._client.close()

    def submit(self, name: str, call: Callable[..., object], *arguments: object) -> Any:
        """Call a module's function on the cluster, under a unique name, and return the future.

        The arguments are plain values, or futures of earlier calls.
        """
        packages = packages_of(call)
        return self._client.submit(
            _call_checked, packages, code_digest(*packages), call, *arguments, key=f"{name}-{self._run}"
        )

    def result(self, future: Any) -> Any:
        """Return the result of a call that was submitted.

        Raises what the call raised, or a `ClusterError` if its workers died again and again, or the scheduler is gone.
        """
        from distributed import CancelledError  # noqa: PLC0415 - an extra, and slow to load
        from distributed.comm.core import CommClosedError  # noqa: PLC0415
        from distributed.scheduler import KilledWorker  # noqa: PLC0415

        try:
            return future.result()
        except KilledWorker:
            name = future.key.rpartition("-")[0]
            raise ClusterError(
                f"{name}: every worker that ran it died, perhaps out of memory: see the logs of the workers"
            ) from None
        except (CancelledError, CommClosedError, TimeoutError) as error:
            raise ClusterError(
                f"{self._address}: the connection to the scheduler was lost ({type(error).__name__}): run again "
                f"when it is available; finished work is kept"
            ) from None


def _hear_scheduler(host: str, port: int) -> None:
    """Raise an OSError if no scheduler answers; Dask itself waits for half a minute or forever.

    A scheduler begins with a frame's size, a number of eight bytes that is not large.
    """
    with socket.create_connection((host, port), _ANSWER_S) as connection:
        connection.settimeout(_ANSWER_S)
        answer = connection.recv(8, socket.MSG_WAITALL)
    if len(answer) < 8 or int.from_bytes(answer, "little") > _LARGEST_GREETING:
        raise ConnectionError("something else answers")


def packages_of(call: Callable[..., object]) -> tuple[str, ...]:
    """Return the packages of the project that a call may run: `datasets`, too, which a wheel has within tbmslam."""
    options: type = importlib.import_module("tbmslam").RecordingOptions
    return "tbmslam", options.__module__.rpartition(".")[0], call.__module__.partition(".")[0]


def _call_checked(packages: tuple[str, ...], digest: str, call: Callable[..., object], *arguments: object) -> object:
    """Make a call where the code is the caller's."""
    if code_digest(*packages) != digest:
        raise ClusterError("a worker has other code of tbmslam than this program: install the same version everywhere")
    return call(*arguments)


@functools.cache
def code_digest(*packages: str) -> str:
    """Return a digest of the Python sources of packages, by import name."""
    digest = hashlib.sha256()
    for package in packages:
        paths = list(importlib.import_module(package).__path__)
        for folder in map(Path, paths):
            for source in sorted(folder.rglob("*.py")):
                digest.update(source.relative_to(folder).as_posix().encode() + b"\0")
                digest.update(source.read_bytes() + b"\0")
    return digest.hexdigest()
