"""Both programs on a real Dask cluster of processes, one of which is killed on the way: the same bytes as without."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from merging import merge
from merging.alignment import Alignment
from merging.config import MergeConfig
from merging.map_graph.grouping import Group
from merging.merge_state import MergeState
from merging.nonrigid.search import register_pairs
from tbmslam.geometry.se2 import SE2
from tbmslam.parallel.executor import Executor
from tests.end_to_end.programs import build, contents, merge_maps, simulate
from tests.merging.bent_floor import bent_maps
from tests.tools.dask_cluster import DaskCluster
from tools.benchmarks.fleet import make_fleet
from tools.map_pairs.placed_maps import maps_by_name

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    """Bags of four robots, their maps and the merged map, made in this process."""
    root = tmp_path_factory.mktemp("local")
    small = ("--beams", 181, "--rate", 5, "--duration", 20)
    simulate(root / "bags", "--world", "apartment", "--robots", 4, *small)
    build(root / "maps", root / "bags", "--separate")
    merge_maps(root / "merged", root / "maps")
    return root


def start(program, *words):
    command = [sys.executable, str(ROOT / "tools" / f"{program}.py"), *map(str, words)]
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(ROOT)})  # noqa: S603 - our own program


def results(folder):
    return {name: data for name, data in contents(folder).items() if not name.endswith("report.html")}


def test_a_killed_worker_changes_nothing(local, tmp_path):
    (tmp_path / "dask").mkdir()
    with DaskCluster(tmp_path / "dask", workers=2) as cluster:
        mapping = start(
            "build_maps", local / "bags", "--separate", "-o", tmp_path / "maps", "--scheduler", cluster.address
        )
        while not list(tmp_path.glob("maps/robot_*/map.npz")) and mapping.poll() is None:
            time.sleep(0.02)
        assert mapping.poll() is None
        cluster.workers[0].kill()
        assert mapping.wait() == 0
        cluster.start_worker()
        merging = start("merge", tmp_path / "maps", "-o", tmp_path / "merged", "--scheduler", cluster.address)
        cluster.wait_until_busy()
        cluster.workers[1].kill()
        assert merging.wait() == 0
    assert results(tmp_path / "maps") == results(local / "maps")
    assert results(tmp_path / "merged") == results(local / "merged")


def test_a_cluster_merges_a_fleet_equally(tmp_path):
    """In rounds: retrieval, pairs, and pairs of which one map is bent."""
    maps = maps_by_name(make_fleet(3, 3, seed=3))
    config = MergeConfig.model_validate({"retrieval": {"few": 2}})
    here = merge(maps, config)
    with DaskCluster(tmp_path, workers=4) as cluster:
        there = merge(maps, config, scheduler=cluster.address)
    for other in (there, merge(maps, config, workers=2)):
        assert dict(other.alignments) == dict(here.alignments)
        assert dict(other.poses) == dict(here.poses)
        assert other.merged.grid.masses.tobytes() == here.merged.grid.masses.tobytes()
    assert any(found.accepted for found in here.alignments.values())


def test_a_cluster_deforms_maps_equally(tmp_path):
    target, source, _ = bent_maps("store")
    maps, pair = {"a": target, "b": source}, ("a", "b")
    groups = [Group({name: SE2.identity()}) for name in maps]
    refused = {pair: Alignment("correlation", accepted=False, reason="it fits nowhere", lead=2.0)}
    found = MergeState.of(maps, refused, lambda _: groups)
    with DaskCluster(tmp_path, workers=1) as cluster:
        there = register_pairs(found, MergeConfig(), Executor(scheduler=cluster.address))
    here = register_pairs(found, MergeConfig(), Executor())
    assert there[pair].alignment == here[pair].alignment
    np.testing.assert_array_equal(there[pair].deformation.centroids, here[pair].deformation.centroids)
