import socket
import sys
import threading
import time
from contextlib import suppress

import pytest

from datasets import __name__ as datasets
from merging.merger import merge
from tbmslam.parallel import cluster
from tbmslam.parallel.cluster import Cluster, ClusterError, code_digest, packages_of


def test_an_address_without_an_answer_is_an_error():
    with pytest.raises(
        ClusterError, match=r"tcp://127\.0\.0\.1:1: no Dask scheduler answers \(.*\): start one with `dask "
    ):
        Cluster("tcp://127.0.0.1:1", timeout_s=0.5)


@pytest.fixture
def stranger():
    """Return a starter of a server that greets with some bytes, and then waits for ever."""
    listeners = []

    def start(greeting):
        listener = socket.create_server(("127.0.0.1", 0))
        listeners.append(listener)

        def greet():
            with suppress(OSError):
                connection, _ = listener.accept()
                listeners.append(connection)
                connection.sendall(greeting)

        threading.Thread(target=greet, daemon=True).start()
        return listener.getsockname()[1]

    yield start
    for listener in listeners:
        listener.close()


@pytest.mark.parametrize(
    ("greeting", "fact"), [(b"SSH-2.0-OpenSSH_9.6\r\n", "something else answers"), (b"", "timed out")]
)
def test_another_server_is_refused_soon(stranger, monkeypatch, greeting, fact):
    monkeypatch.setattr(cluster, "_ANSWER_S", 0.3)
    began = time.monotonic()
    with pytest.raises(ClusterError, match=rf"no Dask scheduler answers \({fact}\): start one"):
        Cluster(f"tcp://127.0.0.1:{stranger(greeting)}")
    assert time.monotonic() - began < 5.0


def test_an_encrypted_scheduler_needs_certificates():
    with pytest.raises(ClusterError, match=r"tls://127\.0\.0\.1:1: no Dask scheduler answers \(.*TLS"):
        Cluster("tls://127.0.0.1:1")


def test_dask_is_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"a cluster needs Dask: pip install 'tbmslam\[cluster\]'"):
        Cluster("tcp://127.0.0.1:1")


def test_a_worker_with_other_code_is_refused():
    with pytest.raises(ClusterError, match="other code of tbmslam than this program: install the same version"):
        cluster._call_checked(("tbmslam",), "0", len, "abc")


@pytest.mark.parametrize(
    "address", ["", "nonsense", "tcp://host", "tcp://a b:1", "host:8786:x", "http://host:8786", "tcp://host:99999"]
)
def test_an_invalid_address_is_refused_at_once(address):
    with pytest.raises(ClusterError, match=r"is no address of a Dask scheduler: it must look like tcp://10"):
        Cluster(address)


def test_the_readers_of_recordings_are_checked_too():
    assert packages_of(merge) == ("tbmslam", datasets, "merging")


def test_another_source_is_another_digest(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    seen = set()
    for text in ("x = 1\n", "x = 2\n"):
        (tmp_path / "sample_code").mkdir(exist_ok=True)
        (tmp_path / "sample_code" / "__init__.py").write_text(text)
        code_digest.cache_clear()
        seen |= {code_digest("sample_code"), code_digest("sample_code")}
    sys.modules.pop("sample_code")
    assert len(seen) == 2
    code_digest.cache_clear()
