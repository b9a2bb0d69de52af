# SPDX-License-Identifier: Apache-2.0
"""A fleet of recordings: everything that can be worked out is, once, whatever happens to one of them or to a worker."""

import ast
import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import settings, wire
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.fleet import fleet_run
from mwd_surface.fleet.fleet_dataset import DONE, FAILED
from project import ROOT

pytestmark = pytest.mark.slow

START = 1_772_344_800_000_000_000
RAW = settings.changed(EstimatorSettings(), {"gravity.method": "raw"})


def recording(path, seed=0):
    """Write the recording of a tool that keeps still for 16 s, with a survey in it."""
    rng, imu, mag = np.random.default_rng(seed), wire.IMU.empty(800), wire.MAG.empty(800)
    imu["stamp_ns"] = mag["stamp_ns"] = START + np.arange(800) * 20_000_000
    imu["linear_acceleration"] = np.array([-7.0, 2.0, 6.5]) + rng.normal(scale=0.01, size=(800, 3))
    imu["angular_velocity"] = rng.normal(scale=1e-3, size=(800, 3))
    mag["magnetic_field"] = np.array([2e-5, 1e-5, 4e-5]) + rng.normal(scale=2e-8, size=(800, 3))
    with BagWriter(path) as bag:
        for name, layout, rows in (("/imu/data_raw", wire.IMU, imu), ("/imu/mag", wire.MAG, mag)):
            bag.write_rows(bag.topic(name, layout.type_name), layout.encode(rows, "sonde_link"), rows["stamp_ns"])
    return path


def run(bags, folder, scheduler="threads", workers=2, estimator=RAW, given=lambda _outcome, _share: None):
    with fleet_run.cluster(scheduler, workers) as client:
        return fleet_run.run(bags, folder, client, estimator, report=given)


def by_name(outcomes):
    return {Path(one.bag).name: one for one in outcomes}


def test_bags_are_found_by_folder_file_and_pattern_each_once(tmp_path):
    recording(tmp_path / "pad" / "a")
    recording(tmp_path / "pad" / "deep" / "b")
    alone = tmp_path / "pad" / "c.mcap"
    shutil.copyfile(next((tmp_path / "pad" / "a").glob("*.mcap")), alone)
    wanted = [tmp_path / "pad" / "a", alone, tmp_path / "pad" / "deep" / "b"]
    for patterns in ([f"{tmp_path}/pad/**"], [str(tmp_path)], [f"{tmp_path}/**/*.mcap", str(tmp_path)]):
        assert fleet_run.find_bags(patterns) == sorted(wanted)
    with pytest.raises(ValueError, match="no recording found"):
        fleet_run.find_bags([f"{tmp_path}/nothing/**"])


def test_a_bag_that_fails_is_an_outcome_and_the_rest_is_worked_out_once(tmp_path):
    bags = [recording(tmp_path / "bags" / name, seed) for seed, name in enumerate(("good", "cut", "empty", "twin"))]
    file = next(bags[1].glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:-100])
    next(bags[2].glob("*.mcap")).write_bytes(b"")
    shutil.rmtree(bags[3])
    shutil.copytree(bags[0], bags[3])
    outcomes = by_name(run(bags, tmp_path / "fleet"))
    assert {name: one.row["outcome"] for name, one in outcomes.items()} == {
        "good": DONE,
        "cut": FAILED,
        "empty": FAILED,
        "twin": DONE,
    }
    assert "mwd recover" in outcomes["cut"].row["reason"]
    assert outcomes["empty"].row["reason"]
    surveys = parquet.read_table(tmp_path / "fleet" / "surveys")
    # The twin is the same recording in another place: it counts once.
    assert surveys.num_rows == 1
    page = fleet_run.index_html(list(outcomes.values()))
    assert page.index("/cut") < page.index("/good")
    assert "mwd recover" in page


def test_called_again_it_keeps_what_is_done_and_does_the_rest(tmp_path):
    bags = [recording(tmp_path / "bags" / name, seed) for seed, name in enumerate(("a", "b"))]
    first = run(bags[:1], tmp_path / "fleet")
    again = by_name(run(bags, tmp_path / "fleet"))
    assert (again["a"].kept, again["b"].kept) == (True, False)
    assert again["a"].row == first[0].row
    shutil.rmtree(bags[0])
    recording(bags[0], seed=7)
    changed = by_name(run(bags, tmp_path / "fleet"))
    assert (changed["a"].kept, changed["b"].kept) == (False, True)
    assert parquet.read_table(tmp_path / "fleet" / "bags").num_rows == 2
    other = run(bags, tmp_path / "fleet", estimator=settings.changed(RAW, {"survey.duration_s": 4.0}))
    assert not any(one.kept for one in other)
    assert parquet.read_table(tmp_path / "fleet" / "bags").num_rows == 2


def test_other_programs_read_a_table_as_one(tmp_path):
    bags = [recording(tmp_path / "bags" / name, seed) for seed, name in enumerate(("a", "b", "c"))]
    run(bags, tmp_path / "fleet")
    # In a process of its own: its module complains when the interpreter ends.
    words = [sys.executable, ROOT / "mwd_surface" / "test" / "programs" / "query_fleet.py", tmp_path / "fleet"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    surveys, bins = (ast.literal_eval(line) for line in done.stdout.splitlines())
    assert surveys[:2] == (3, 3)
    assert 40.0 < surveys[2] < 50.0
    assert bins[0] == 3 * 800


def test_a_worker_that_is_killed_costs_nothing_but_time(tmp_path):
    bags = [recording(tmp_path / "bags" / f"{seed:02d}", seed) for seed in range(10)]
    killed = []

    def kill_the_first(outcome, _share):
        if not killed:
            killed.append(int(outcome.row["worker"].rpartition(":")[2]))
            os.kill(killed[0], signal.SIGKILL)

    outcomes = run(bags, tmp_path / "fleet", "processes", given=kill_the_first)
    assert killed
    assert [one.row["outcome"] for one in outcomes] == [DONE] * 10
    assert len({one.row["worker"] for one in outcomes}) > 1
    assert parquet.read_table(tmp_path / "fleet" / "bags").num_rows == 10
    uuids = parquet.read_table(tmp_path / "fleet" / "surveys").column("uuid").to_pylist()
    assert len(uuids) == 10
    assert not list((tmp_path / "fleet").rglob("*.unfinished"))


def test_two_clusters_side_by_side_have_nothing_to_warn_of():
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        with fleet_run.cluster("threads", 1) as one, fleet_run.cluster("threads", 1) as other:
            assert one.submit(int, 4).result() + other.submit(int, 5).result() == 9


def test_an_interrupted_batch_ends_with_one_sentence(tmp_path):
    bags = [recording(tmp_path / "pad" / f"bag_{k}", k) for k in range(3)]
    words = [sys.executable, "-P", "-m", "mwd_surface.cli", "batch", *map(str, bags), "-o", str(tmp_path / "fleet")]
    process = subprocess.Popen(
        [*words, "--workers", "1"], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    while not (tmp_path / "fleet" / "bags").is_dir() and process.poll() is None:
        time.sleep(0.02)
    # As a terminal does: to every process of the group.
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert "run the same command again" in said


@pytest.mark.parametrize(
    ("scheduler", "words"),
    [
        ("spark", "expected local, processes, threads or tcp"),
        ("tls://127.0.0.1:1", "needs --tls-ca, --tls-cert, --tls-key"),
    ],
)
def test_a_scheduler_that_is_unknown_or_lacks_its_certificates_is_refused(scheduler, words):
    with pytest.raises(ValueError, match=words), fleet_run.cluster(scheduler):
        pass
