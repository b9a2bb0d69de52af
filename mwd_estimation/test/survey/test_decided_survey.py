# SPDX-License-Identifier: Apache-2.0
"""The record of a decided survey against the definition of its message and the numbers of its station."""

import dataclasses
import math
import re

import numpy as np
import pytest

from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings, Gravity
from mwd_estimation.survey import survey as records
from mwd_sensors.core import wire
from project import MESSAGES

START = 1_700_000_000 * 10**9


def _survey(with_mag):
    imu = wire.IMU.empty(1600)
    imu["stamp_ns"] = START + np.arange(1600) * 10_000_000
    imu["linear_acceleration"] = np.random.default_rng(1).normal([-6.0, 0.0, -7.7], 5e-3, (1600, 3))
    imu["angular_velocity"] = np.random.default_rng(2).normal(0.0, 1e-3, (1600, 3))
    pipeline = Pipeline(EstimatorSettings(gravity=Gravity("s3")))
    if with_mag:
        mag = wire.MAG.empty(1600)
        mag["stamp_ns"] = imu["stamp_ns"]
        mag["magnetic_field"] = np.random.default_rng(3).normal([2e-5, 1e-5, 4e-5], 1e-8, (1600, 3))
        pipeline.push_mag(mag)
    return pipeline.push_imu(imu).surveys[0]


def _declared(name):
    text = (MESSAGES / f"{name}.msg").read_text()
    constants = {m[1]: int(m[2]) for m in re.finditer(r"^uint8 ([A-Z_]+)=(\d+)", text, re.MULTILINE)}
    fields = re.findall(r"^[A-Za-z]\S* ([a-z]\w*)", text, re.MULTILINE)
    return set(fields), constants


def test_the_fields_and_codes_are_those_of_the_message():
    fields, constants = _declared("Survey")
    ours = {field.name for field in dataclasses.fields(records.Survey)}
    assert ours - {"stamp_ns", "frame_id"} == fields - {"header"}
    codes = {one.name: int(one) for one in records.Verdict}
    assert constants == codes | {"STATIC": records.STATIC, "ROTARY": records.ROTARY}
    names, _ = _declared("AzimuthEstimate")
    assert {field.name for field in dataclasses.fields(records.AzimuthEstimate)} == names


@pytest.mark.parametrize("with_mag", [True, False])
def test_unknown_is_written_as_the_message_defines_it(with_mag):
    found = _survey(with_mag).record()
    assert np.isnan(found.magnetic_field_covariance).any() == (not with_mag)
    assert math.isnan(found.b_total) == (not with_mag)
    assert math.isnan(found.covariance[4]) == (not with_mag)
    assert math.isnan(found.temperature)
    # Without a reference only gravity is judged, against the standard one.
    assert np.isnan([found.b_limit, found.dip_limit]).all()
    assert found.g_limit > 0.0


def test_deviations_are_those_that_the_verdict_took():
    decided = _survey(with_mag=True)
    assert decided.record().g_deviation == decided.station.deviations.gravity
    assert np.isnan([decided.record().b_deviation, decided.record().dip_deviation]).all()


def test_the_record_names_its_frame_and_when_and_from_what_it_was_measured():
    decided = dataclasses.replace(_survey(with_mag=True), status=5)
    found = decided.record("w1/sonde_link")
    average = decided.average
    assert (found.frame_id, found.status, found.samples) == ("w1/sonde_link", 5, average.imu.count)
    assert found.stamp_ns - START < average.end_ns - START == pytest.approx((found.stamp_ns - START) * 2, abs=2e10)
    assert found.duration == pytest.approx((average.end_ns - average.start_ns) * 1e-9)
    assert found.specific_force == tuple(average.imu.mean[3:])
