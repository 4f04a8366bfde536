import gc
import json

import numpy as np
import pytest

from tbmslam.configuration.slam_config import preset
from tbmslam.geometry.se2 import SE2
from tbmslam.parallel.worker_pool import worker_pool
from tbmslam.sensing.laser_scan import LaserScan, Reading
from tools.benchmark import main
from tools.benchmarks import slam as module
from tools.benchmarks.slam import Result, SlamRun, by_preset, median_run, seeds_table


def figures(mapping_s=1.0, beams=1040, ate_m=None):
    return SlamRun(
        scans=1000,
        beams=beams,
        keyframes=10,
        duration_s=50.0,
        reading_s=0.1,
        mapping_s=mapping_s,
        finishing_s=0.1,
        wall_s=1.2,
        peak_memory_mb=300.0,
        ate_m=ate_m,
    )


def test_a_simulated_drive(tmp_path, capfd, monkeypatch):
    """Runs in another process; one for all runs, which would otherwise start with seconds of imports."""
    started = []
    path = tmp_path / "figures.json"
    world = "apartment:1:good,beams=91,duration=6"
    tables = tmp_path / "tables.json"
    with worker_pool(1) as pool:
        monkeypatch.setattr(
            module,
            "in_fresh_process",
            lambda run, *words: started.append(words) or pool.result(pool.submit(run, *words)),
        )
        assert main(["slam", "--world", world, "--seeds", "2", "--json", str(path), "--table", str(tables)]) == 0
    assert [name for _, name in started] == ["default"] * 3  # the first one is not counted
    out, err = capfd.readouterr()
    table = [line for line in out.splitlines() if line.startswith("|")][:4]
    assert len({len(line) for line in table}) == 1
    assert [line.split("|")[2].strip() for line in table[2:]] == ["default"] * 2
    written = json.loads(tables.read_text())["tables"]
    (seeds,) = written["seeds"]["rows"]
    assert seeds[:4] == ["apartment:*:good,beams=91,duration=6", "default", "2", "0"]
    assert f"| {' | '.join(seeds[:2])} |" in out
    assert [row[1] for row in written["drives"]["rows"]] == ["default"] * 2
    assert [len(written[name]["rows"]) for name in ("errors", "speeds")] == [1, 1]
    assert "A first run, which is not counted, fills" in out
    assert f"benchmark: {world} default" in err
    record = json.loads(path.read_text())
    assert record["machine"]["numba"]
    for result in record["results"]:
        run = result["median"]
        assert (run["scans"], run["beams"]) == (120, 91)
        assert run["ate_m"] < 0.1
        assert run["translation_error_m"] is None
        assert 0.0 < run["finishing_s"] < run["mapping_s"]
        assert 50.0 < run["peak_memory_mb"] < 2000.0


def test_the_median_of_each_figure_counts():
    median = median_run([figures(1.0, ate_m=0.5), figures(9.0, ate_m=0.5), figures(2.0, ate_m=0.5)])
    assert median.mapping_s == pytest.approx(2.0)
    assert median.ate_m == pytest.approx(0.5)
    assert median.translation_error_m is None


def test_the_median_of_an_even_number_of_runs_keeps_whole_numbers():
    median = median_run([figures(1.0), figures(2.0)])
    assert (str(median.scans), median.mapping_s) == ("1000", 1.0)


def test_the_worst_of_several_seeds_is_named():
    results = [
        Result(f"office:{seed}:poor", "default", figures(ate_m=error), (), "office:*:poor")
        for seed, error in ((1, 0.01), (2, 0.75), (3, 0.02))
    ]
    alone = Result("halls:1:good", "default", figures(ate_m=0.1), (), "halls:*:good")
    assert seeds_table([*results, alone, Result("intel", "default", figures(), ())]).rows == [
        ["office:*:poor", "default", "3", "1", "0.0200", "0.7500", "office:2:poor"]
    ]


def test_presets_stand_below_each_other():
    runs = [Result(name, preset, figures(0.5, ate_m=0.1), ()) for preset in ("viny", "tiny") for name in ("a", "b")]
    tables = by_preset(runs)
    assert tables["errors"].columns == ("preset", "a", "b")
    assert tables["errors"].rows == [["viny", "0.1000", "0.1000"], ["tiny", "0.1000", "0.1000"]]
    assert tables["speeds"].rows[1] == ["tiny", "2000", "2000"]


def test_a_loop_is_closed_and_only_the_first_scans_are_read(monkeypatch):
    scan = LaserScan(0.0, -1.5, 0.05, 0.1, 20.0, np.full(60, 2.0))
    read, made = [], []

    def readings():
        for number in range(100):
            read.append(number)
            yield Reading(scan, SE2.identity())

    class Noted(module.Slam):
        def finish(self, *args):
            made.append(super().finish(*args))
            return made[-1]

    monkeypatch.setattr(module, "Slam", Noted)
    module.warm_up(preset("default"), readings())
    gc.unfreeze()
    assert len(read) == module.WARM_UP_SCANS
    assert [len(tbm_map.drives[0].closures) > 0 for tbm_map in made] == [False, True]
