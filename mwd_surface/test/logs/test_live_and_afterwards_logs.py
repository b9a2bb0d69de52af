# SPDX-License-Identifier: Apache-2.0
"""The log of a run is the same bits live, computed from the recording and viewed; files hold its numbers."""

import dataclasses
import io

import lasio
import numpy as np
import pytest
from lxml import etree
from pyarrow import parquet
from typer.testing import CliRunner

from mwd_estimation.downhole.log_sampler import LogSampler
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_sensors.core import wire
from mwd_sensors.simulator.scenario import parse
from mwd_sensors.simulator.sonde import Sonde
from mwd_sensors.telemetry.log_channels import CHANNELS, LogSample
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.cli import app
from mwd_surface.logs.depth_log import FIRST
from mwd_surface.logs.recorded_log import recorded_samples
from mwd_surface.logs.tool_health import HealthLedger
from mwd_surface.page.state_json import StateJson
from mwd_surface.processing.bag_input import InputSettings
from mwd_surface.processing.log_estimate import computed_samples
from mwd_surface.runs import simulate
from mwd_surface.runs.player import Player, recorded_depths
from mwd_surface.runs.simulate import estimator_settings
from mwd_surface.surveys.recorded_settings import recorded_settings
from project import REFERENCE_DATA

pytestmark = pytest.mark.slow

SCENARIO = parse(
    """
name: logged
seed: 3
date: 2026-03-01T06:00:00
precision: null
well: {stations: [[0.0, 88.0, 40.0], [600.0, 88.0, 40.0]], bit_m: 100.0, sensor_to_bit_m: 3.0}
gamma: {formation: [[0.0, 40.0], [101.0, 150.0]], by: md, sensor_to_bit_m: 2.0}
battery: {used_ah: 1.0}
schedule:
  - {kind: still, seconds: 11.0}
  - {kind: drill, seconds: 40.0, rpm: 90.0, rop_m_h: 432.0}
  - {kind: still, seconds: 11.0}
"""
)


def live_samples(seconds):
    """What the estimator gives for the blocks of the sonde, of a length in s."""
    sonde = Sonde(SCENARIO)
    pipeline, sampler, found = Pipeline(estimator_settings(sonde)), LogSampler(CHANNELS), []
    for block in sonde.blocks(seconds):
        pipeline.push_mag(block["imu/mag"])
        pipeline.push_temperature(block["imu/temperature"])
        output = pipeline.push_imu(block["imu/data_raw"])
        sampler.push("counts", block[wire.GAMMA_TOPIC])
        sampler.push("status", block[wire.STATUS_TOPIC])
        sampler.push("temperature", block["imu/temperature"])
        sampler.push("dynamics", output.dynamics)
        found += sampler.advance(output.attitude)
    return found + sampler.finish()


@pytest.fixture(scope="module")
def live():
    return live_samples(0.13)


@pytest.fixture(scope="module")
def bags(tmp_path_factory, live):
    """The recording of the sonde, and the same with the log samples of the estimator."""
    folder = tmp_path_factory.mktemp("logged")
    simulate.record(SCENARIO, folder / "raw", "w1")
    with Bag(folder / "raw") as raw, BagWriter(folder / "logged") as out:
        channels = {t.name: out.topic(t.name, t.type_name) for t in raw.topics.values()}
        log = out.topic("/w1/log", LogSample.MESSAGE)
        waiting = list(live)
        for at, topic, _, data in raw.messages():
            while waiting and waiting[0].stamp_ns + 7 * 10**9 < at:
                message = waiting.pop(0).to_message(out.definitions.make)
                out.write(log, bytes(out.definitions.typestore.serialize_cdr(message, LogSample.MESSAGE)), at)
            out.write(channels[topic], data, at)
        for name, table in raw.metadata().items():
            out.add_metadata(name, table)
        left = len(waiting)
    assert left < len(live) / 2
    return folder / "raw", folder / "logged"


def test_live_and_computed_samples_are_the_same(live, bags):
    with Bag(bags[0]) as bag:
        recorded = recorded_settings(bag)
        computed = computed_samples(bag, recorded.estimator, InputSettings(), dict(CHANNELS), recorded)
    assert {sample.channel for sample in computed} == set(CHANNELS)
    assert computed == live == live_samples(5.0)


def test_the_viewed_log_is_that_of_the_recorded_samples(bags):
    with Bag(bags[1]) as bag:
        player = Player(bag, "/w1/")
        player.seek(player.length_s)
        viewed = player.state().logs
        table = StateJson().snapshot(player.state())["sections"]["logs"]
        health = HealthLedger()
        log = recorded_depths(bag, "w1")
        for sample in recorded_samples(bag, "w1"):
            log.add([sample])
            health.add(sample)
        afterwards = log.curves(FIRST)
        shown = player.state().tool_health
        assert shown.exposures == health.health().exposures
        assert shown.failed_tests == ()
        assert shown.battery.used == pytest.approx(3600.0, rel=0.1)
    assert [curve.channel for curve in viewed] == [curve.channel for curve in afterwards]
    for one, two in zip(viewed, afterwards, strict=True):
        for field in dataclasses.fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))
    gamma = next(one for one in table["channels"] if one["name"] == "gamma")
    assert len(gamma["rows"]) == len(gamma["sectors"]) > 10


def test_the_bed_stands_at_its_depth_in_every_file(bags, tmp_path):
    for ending in ("las", "csv", "parquet", "xml"):
        done = CliRunner().invoke(app, ["log", str(bags[0]), "-o", str(tmp_path / f"g.{ending}"), "--compute"])
        assert done.exit_code == 0, done.output
    las = lasio.read(io.StringIO((tmp_path / "g.las").read_text()))
    assert las.curves["GR"].unit == "GAPI"
    depth, gamma, sigma = las["DEPT"], las["GR"], las["GRS"]
    seen = np.isfinite(gamma)
    above, below = seen & (depth < 100.3), seen & (depth > 101.7)
    assert above.sum() > 5
    assert below.sum() > 5
    for part, true in ((above, 40.0), (below, 150.0)):
        # Steps share samples, so their errors are not independent.
        assert np.abs(gamma[part].mean() - true) < 3.0 * sigma[part].mean()
    name = "{http://www.witsml.org/schemas/1series}"
    schema = etree.XMLSchema(etree.parse(REFERENCE_DATA / "witsml" / "xsd" / "obj_log.xsd"))
    schema.assertValid(etree.parse(tmp_path / "g.xml"))
    log = etree.parse(tmp_path / "g.xml").getroot().find(f"{name}log")
    at = log.findtext(f"{name}logData/{name}mnemonicList").split(",").index("GR")
    cells = [one.text.split(",")[at] for one in log.iterfind(f"{name}logData/{name}data")]
    np.testing.assert_array_equal([float(cell) if cell else np.nan for cell in cells], gamma)
    assert [one.findtext(f"{name}mnemonic") for one in log.iterfind(f"{name}logCurveInfo")][:1] == ["DEPT"]
    table = parquet.read_table(tmp_path / "g.parquet").to_pydict()
    np.testing.assert_array_equal(np.array(table["gamma"], dtype=float), gamma)
    rows = (tmp_path / "g.csv").read_text().splitlines()
    assert rows[0].split(",")[0] == "md_m"
    assert {"gamma_gAPI", "gamma_sigma_gAPI", "battery_voltage_V", "consumed_charge_C"} <= set(rows[0].split(","))
    assert float(rows[1].split(",")[0]) == depth[0]
    assert np.nanmean(las["INCL"]) == pytest.approx(88.0, abs=1.0)


def test_the_memory_of_a_run_is_merged_whatever_its_clock_says(bags, tmp_path):
    """A clock that is 40 s and 30 ppm off; the run has only part of the samples."""
    arguments = ["memory", "dump", str(bags[0]), "-o", str(tmp_path / "dump")]
    done = CliRunner().invoke(app, [*arguments, "--clock-offset", "40", "--clock-drift", "30"])
    assert done.exit_code == 0, done.output
    done = CliRunner().invoke(
        app, ["memory", "merge", str(bags[1]), str(tmp_path / "dump"), "-o", str(tmp_path / "m.las")]
    )
    assert done.exit_code == 0, done.output
    assert float(done.output.split("clock of the tool's memory: ")[1].split()[0]) == pytest.approx(40.0, abs=0.1)
    assert "filled from the memory" in done.output
    depth, gamma = (lasio.read(io.StringIO((tmp_path / "m.las").read_text()))[name] for name in ("DEPT", "GR"))
    assert np.nanmean(gamma[depth < 100.5]) == pytest.approx(40.0, abs=5.0)
    assert np.nanmean(gamma[depth > 101.5]) == pytest.approx(150.0, abs=8.0)


def test_a_recording_without_samples_or_with_a_wrong_option_says_what_to_do(bags, tmp_path):
    for arguments, words in (
        ([], "--compute"),
        (["--compute", "--pass", "last"], "first, deepest, all"),
        (["--compute", "--tool", str(tmp_path / "none.yaml")], "none.yaml"),
    ):
        done = CliRunner().invoke(app, ["log", str(bags[0]), "-o", str(tmp_path / "g.las"), *arguments])
        assert done.exit_code != 0
        assert words in done.output + str(done.exception)
    assert not (tmp_path / "g.las").exists()
