# SPDX-License-Identifier: Apache-2.0
"""A command gives the same results from a recording, its file, the folder of its run, and results computed from it."""

import shutil

import pytest
from test_cli import mwd

from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.simulator.scenario import parse
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.processing import process
from mwd_surface.runs import simulate
from mwd_surface.surveys.recorded_settings import recorded_settings

pytestmark = pytest.mark.slow(1.5)

STORY = """
name: s
seed: 5
date: 2026-03-01T06:00:00
well: {stations: [[0.0, 30.0, 40.0], [600.0, 60.0, 40.0]], bit_m: 33.0, sensor_to_bit_m: 3.0}
schedule:
  - {kind: still, seconds: 14.0}
  - {kind: drill, seconds: 10.0, rpm: 60.0, rop_m_h: 3600.0}
  - {kind: still, seconds: 14.0}
"""


@pytest.fixture(autouse=True)
def _undrawn(monkeypatch):
    """Leave the drawing of reports to the tests of exports."""
    for kind in ("html", "pdf"):
        monkeypatch.setattr(f"mwd_surface.exports.report_{kind}.report_{kind}", lambda _table: "a report")


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """Recording, its file, the folder of a run that contains it, and results computed from it."""
    folder = tmp_path_factory.mktemp("sources")
    bag, run, results = folder / "bag", folder / "run", folder / "results"
    simulate.record(parse(STORY), bag)
    shutil.copytree(bag, run / "bags" / "bag")
    with Bag(bag) as opened:
        recorded = recorded_settings(opened)
        process.process(opened, results, recorded.estimator or EstimatorSettings(), recorded=recorded)
    return {"recording": bag, "file": next(bag.glob("*.mcap")), "run": run, "results": results}


def lines(path):
    """Return the lines of a file that are not comments: those name the source and the time of writing."""
    return [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]


@pytest.mark.parametrize(
    ("words", "written"),
    [
        (["export", "-f", "csv", "-o", "a.csv"], "a.csv"),
        (["export", "-f", "timeseries", "-o", "a.csv"], "a.csv"),
        (["path", "-o", "a"], "a/path.csv"),
        (["finalize", "-o", "a"], "a/definitive.csv"),
        (["process", "-o", "a"], "a/surveys.csv"),
    ],
    ids=lambda words: words[0] if isinstance(words, list) else "",
)
def test_a_command_takes_each_place_alike(words, written, places, tmp_path):
    found = {}
    for name, place in places.items():
        folder = tmp_path / name
        folder.mkdir()
        done = mwd(words[0], place, *(folder / word if word.startswith("a") else word for word in words[1:]))
        assert done.returncode == 0, done.stderr
        found[name] = lines(folder / written)
    assert len(found["recording"]) > 1
    assert all(rows == found["recording"] for rows in found.values())


@pytest.mark.parametrize(
    "words", [["inspect"], ["plot", "-o", "a.svg"], ["report", "-o", "a"]], ids=lambda words: words[0]
)
def test_no_place_is_refused(words, places, tmp_path):
    for name, place in places.items():
        folder = tmp_path / name
        folder.mkdir()
        done = mwd(words[0], place, *(folder / word if word.startswith("a") else word for word in words[1:]))
        assert done.returncode == 0, done.stderr
