# SPDX-License-Identifier: Apache-2.0
"""`mwd calibrate` as people call it: tables and a file, from a scenario or a recording, or one sentence why not."""

import pytest
import typer
import yaml

from invoked_command import invoke
from mwd_sensors.simulator import scenario
from mwd_surface.commands.calibrate import calibrate
from mwd_surface.runs import calibration_run, simulate
from project import SCENARIOS

pytestmark = pytest.mark.slow

TUMBLE = SCENARIOS / "tumble.yaml"
# Half of its time, where it does not matter how well bias and scale over temperature are told apart.
ONCE = {"cycles": 1}
APP = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
APP.command()(calibrate)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A recording that does not say where it was made."""
    path = tmp_path_factory.mktemp("calibrate") / "run"
    simulate.record(scenario.read(TUMBLE, ONCE), path)
    return path


def run(*words):
    return invoke(APP, *words)


@pytest.fixture
def once(tmp_path):
    """The scenario with half of its time."""
    path = tmp_path / "once.yaml"
    path.write_text(yaml.safe_dump({**yaml.safe_load(TUMBLE.read_text()), **ONCE}))
    return path


def test_a_scenario_gives_tables_and_a_file(once, tmp_path):
    done = run(once, "-o", tmp_path / "cal.yaml", "--seed", 3)
    assert "scenario tumble, seed 3, ahrs: residuals, root mean square" in done.stdout
    for words in ("accelerometers", "magnetometers", "deg/h", "scale over temperature, ppm/°C", "±"):
        assert words in done.stdout
    assert calibration_run.read(tmp_path / "cal.yaml").magnetometer.poses == 30


def test_the_precision_unit_of_another_grade_is_calibrated(once, tmp_path):
    run(once, "-o", tmp_path / "cal.yaml", "--unit", "precision", "--grade", "tactical_north")
    found = calibration_run.read(tmp_path / "cal.yaml", "precision")
    assert found.magnetometer is None
    # 200 ug over tools, 3 ug/degC: nothing of the size of the AHRS's.
    assert abs(found.accelerometer.bias).max() < 1e-2


def test_the_place_of_a_recording_can_be_given(bag, tmp_path):
    place = scenario.read(TUMBLE).place
    where = ("--lat", place.latitude_deg, "--lon", place.longitude_deg)
    run(bag, "-o", tmp_path / "a.yaml", *where)
    done = run(bag, "-o", tmp_path / "b.yaml", "--gravity", 9.795)
    assert calibration_run.read(tmp_path / "a.yaml").magnetometer is not None
    assert calibration_run.read(tmp_path / "b.yaml").magnetometer is None
    assert "magnetometers are not calibrated" in done.output


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--unit", "ahr"], "did you mean ahrs"),
        (["--grade", "mti3"], "only for scenarios, not for a recording"),
        ([], "give the place with --lat and --lon, or --gravity"),
        (["--lat", "60"], "give both, or neither"),
        (["--date", "2026-01-01"], "has no effect without"),
        (["--lat", "60", "--lon", "5", "--date", "soon"], "write it as YYYY-MM-DD"),
        (["--lat", "60", "--lon", "5", "--field", "50000,70"], "give only one of them"),
    ],
)
def test_a_mistake_is_one_sentence_and_leaves_no_file(bag, tmp_path, words, sentence):
    with pytest.raises(ValueError, match=sentence):
        run(bag, "-o", tmp_path / "cal.yaml", *words)
    assert not (tmp_path / "cal.yaml").exists()


@pytest.mark.parametrize(
    ("name", "options", "sentence"),
    [("no_such", [], "no such scenario or file"), (TUMBLE, ["--grade", "mti9"], "no such grade; did you mean mti3")],
)
def test_an_unknown_scenario_or_grade_names_its_near_misses(tmp_path, monkeypatch, name, options, sentence):
    monkeypatch.setattr("mwd_sensors.simulator.scenario_files.names", lambda: {"tumble": TUMBLE})
    with pytest.raises(ValueError, match=sentence):
        run(name, "-o", tmp_path / "cal.yaml", *options)
