# SPDX-License-Identifier: Apache-2.0
"""Scenarios: every one that is shipped can be read and started; a wrong word is met with the right one."""

from __future__ import annotations

import datetime

import numpy as np
import pytest

from mwd_sensors.core.settings import SettingsError, changed
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

FILES = sorted(SCENARIOS.rglob("*.yaml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_shipped_scenario_starts_and_makes_finite_samples(path):
    given = scenario.read(path)
    assert given.name == path.stem
    assert given.about.endswith(".")
    sonde = Sonde(given)
    block = next(sonde.blocks(0.5))
    assert len(block["truth"]) == given.rate_hz // 2
    for samples in block.values():
        for field in samples.dtype.names:
            assert np.isfinite(samples[field]).all()


def test_the_cases_that_the_project_promises_are_all_there():
    names = {path.stem for path in FILES}
    bench = "rot155 vib50 drillvib stickslip whirl shocks build offaxis biasdrift gyroclip surge"
    asked = (
        "default s3_rotation s3_vibration s1_lab s1_field s0_table horizontal_east_west vertical near_polar "
        "curve_and_lateral stick_slip_hell sliding connections tumble casing faults"
    )
    assert {*bench.split(), *asked.split()} <= names


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("{rig: {ramp: 3.0}}", r"rig\.ramp: .*did you mean ramp_s"),
        ("{schedule: [{kind: drill, rmp: 100.0}]}", r"schedule\[0\]\.rmp: .*did you mean rpm"),
        ("{schedule: [{kind: stil}]}", "did you mean still"),
        ("{place: {latitude_deg: 91.0}}", r"place\.latitude_deg: 91 deg .*90 deg"),
        ("[1, 2]", "expected a table"),
        ("{a: [", "YAML"),
        ("{date: yesterday}", "must look like"),
        ("{schedule: []}", "at least one phase"),
        ("{rate_hz: 300}", "must be a multiple of twice the converter rate"),
        ("{rate_hz: 50, rig_hz: 20}", "multiple of rig_hz"),
        ("{ahrs: {grade: mti4}}", "did you mean mti3"),
        ("{ahrs: {changes: {gyro: {rnage_deg_s: 1.0}}}}", "range_deg_s"),
        ("{interference: {soft_iron: [[0.0, 0.0, 0.0]]}}", "three rows"),
        ("{interference: {anomalies: [{md_m: 20, field_nt: &none [0, 0, 0]}, {md_m: 10, field_nt: *none}]}}", "ascend"),
        ("{faults: [{component: gyro, fault: slow, axis: x}]}", "whole messages"),
        ("{vibration: {random: [{band_hz: [50.0, 10.0]}]}}", "below the highest"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place_and_reason(text, match):
    with pytest.raises(SettingsError, match=match):
        scenario.parse(text)


def test_dates_may_be_written_with_or_without_quotes_and_with_a_time():
    expected = datetime.datetime(2026, 3, 1, 6, tzinfo=datetime.UTC)
    assert scenario.parse_date(scenario.parse("{date: 2026-03-01T06:00:00Z}").date) == expected
    assert scenario.parse_date(scenario.parse("{date: '2026-03-01T06:00:00'}").date) == expected
    assert scenario.parse_date(scenario.parse("{date: 2026-03-01}").date).hour == 0


def test_a_seed_or_any_setting_can_be_changed():
    given = scenario.parse("{seed: 1}", {"seed": 2})
    assert given.seed == 2
    assert changed(given, {"place.latitude_deg": 60.0}).place.latitude_deg == 60.0


def test_errors_of_a_file_name_the_file(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("{sede: 1}")
    with pytest.raises(SettingsError, match=r"bad\.yaml: sede"):
        scenario.read(path)
