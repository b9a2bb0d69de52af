# SPDX-License-Identifier: Apache-2.0
"""Surveys in a magnetic storm: the observatory file in the settings corrects the azimuth and marks the survey."""

import dataclasses
import datetime
import os

import numpy as np
import pytest

from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.pipeline.external_field import Observatory
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place
from mwd_sensors.core import wire
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_sensors.core.settings import SettingsError, changed

START = int(datetime.datetime(2026, 3, 1, 6, tzinfo=datetime.UTC).timestamp()) * 10**9
FIELD = {"place.field": "fixed", "place.total_nt": 50000.0, "place.dip_deg": 70.0, "place.declination_deg": 2.0}
STORM_NT = np.array([-150.0, 700.0, 90.0])
TRUE = (0.8, 1.9)


BEFORE_NS = 330 * 60 * 10**9  # the record begins so long before the survey


def _file(path, minutes=400, missing=()):
    """A record that is quiet for five hours, and then in a storm."""
    rng = np.random.default_rng(8)
    first_ns = START - BEFORE_NS
    lines = [" Format                 IAGA-2002        |", "DATE       TIME         DOY     TSTX      TSTY      TSTZ |"]
    for k in range(minutes):
        at = datetime.datetime.fromtimestamp(first_ns * 1e-9, tz=datetime.UTC) + datetime.timedelta(minutes=k)
        values = [17000.0, 600.0, 47000.0] + rng.normal(0.0, 0.5, 3) + (STORM_NT if k >= 300 else 0.0)
        shown = [99999.0] * 3 if k in missing else values
        lines.append(f"{at:%Y-%m-%d %H:%M:%S}.000 {at:%j}   " + "".join(f"{value:10.2f}" for value in shown))
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def _survey(settings):
    """The survey of a tool at rest in the field of the settings with the storm added."""
    return _surveyed(settings)[1]


def _surveyed(settings):
    """That survey, behind the pipeline that took it."""
    n = 2000
    total, dip, declination = 5e-5, np.radians(70.0), np.radians(2.0)
    quiet = total * np.array([np.cos(dip) * np.cos(declination), np.cos(dip) * np.sin(declination), np.sin(dip)])
    mat = mat_nt(*TRUE, 0.3)
    rng = np.random.default_rng(3)
    imu, mag = wire.IMU.empty(n), wire.MAG.empty(n)
    imu["stamp_ns"] = mag["stamp_ns"] = START + 10**7 * np.arange(n)
    imu["angular_velocity"] = 1e-3 * rng.normal(size=(n, 3))
    imu["linear_acceleration"] = mat.T @ [0.0, 0.0, -9.81] + 5e-3 * rng.normal(size=(n, 3))
    mag["magnetic_field"] = mat.T @ (quiet + 1e-9 * STORM_NT) + 5e-8 * rng.normal(size=(n, 3))
    pipeline = Pipeline(settings)
    pipeline.push_mag(mag)
    surveys = pipeline.push_imu(imu).surveys + pipeline.finish().surveys
    assert len(surveys) == 1
    return pipeline, surveys[0].station


def _codes(station):
    return {reason.code for reason in station.reasons}


def test_the_storm_is_taken_off_and_the_survey_says_so(tmp_path):
    plain = changed(EstimatorSettings(), {**FIELD, "survey.north": "true"})
    with_file = changed(plain, {"place.observatory_file": _file(tmp_path / "tst.min")})
    blind, aided = _survey(plain), _survey(with_file)
    # 700 nT east of 17 100 nT horizontal turn the compass by 2.3 deg.
    assert abs(np.degrees(wrap_pi(blind.azimuth - TRUE[1]))) > 1.5
    assert abs(wrap_pi(aided.azimuth - TRUE[1])) < 2.0 * aided.sigma_azimuth
    assert abs(np.degrees(wrap_pi(aided.azimuth - TRUE[1]))) < 0.5
    assert ReasonCode.MAGNETIC_STORM in _codes(aided)
    pipeline, _ = _surveyed(with_file)
    assert ReasonCode.MAGNETIC_STORM in _codes(pipeline.judging_again(1)()[1].station)
    assert "observatory TST" in aided.reference.source


def test_a_time_without_data_is_said_and_the_reference_left_alone(tmp_path):
    path = _file(tmp_path / "tst.min", missing=range(310, 350))
    settings = changed(EstimatorSettings(), {**FIELD, "place.observatory_file": path})
    station = _survey(settings)
    assert ReasonCode.EXTERNAL_FIELD_UNKNOWN in _codes(station)
    assert station.reference.external is None


def test_a_missing_or_wrong_file_is_refused_at_once(tmp_path):
    with pytest.raises(SettingsError, match=r"place\.observatory_file"):
        Pipeline(changed(EstimatorSettings(), {**FIELD, "place.observatory_file": str(tmp_path / "none.min")}))
    (tmp_path / "wrong.min").write_text("hello\n")
    with pytest.raises(SettingsError, match="IAGA-2002"):
        Observatory(Place(observatory_file=str(tmp_path / "wrong.min")))


def test_data_that_arrive_later_are_used(tmp_path):
    path = tmp_path / "tst.min"
    place = Place(observatory_file=_file(path, minutes=325))
    observatory = Observatory(place)
    reference = dataclasses.replace(
        _survey(changed(EstimatorSettings(), {**FIELD, "survey.north": "true"})).reference, external=None
    )
    assert observatory.at(reference, START).external is None
    _file(path)
    os.utime(path, ns=(1, 1))
    assert observatory.at(reference, START).external.strength == pytest.approx(
        1e-9 * np.linalg.norm(STORM_NT), rel=1e-3
    )
