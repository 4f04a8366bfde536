import sys

import pytest

from tbmslam.parallel import cluster
from tbmslam.parallel.cluster import Cluster, ClusterError


def test_nobody_answers():
    with pytest.raises(
        ClusterError, match=r"tcp://127\.0\.0\.1:1: no Dask scheduler answers \(.*\): start one with `dask "
    ):
        Cluster("tcp://127.0.0.1:1", timeout_s=0.5)


def test_dask_is_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"a cluster needs Dask: pip install 'tbmslam\[cluster\]'"):
        Cluster("tcp://127.0.0.1:1")


def test_a_worker_with_other_code_is_refused():
    with pytest.raises(ClusterError, match="other code of tbmslam than this program: install the same version"):
        cluster._call_checked(("tbmslam",), "0", len, "abc")


@pytest.mark.parametrize("address", ["", "nonsense", "tcp://host", "tcp://a b:1", "host:8786:x"])
def test_what_is_no_address_is_told_at_once(address):
    with pytest.raises(ClusterError, match=r"is no address of a Dask scheduler: it must look like tcp://10"):
        Cluster(address)
