# SPDX-License-Identifier: Apache-2.0
"""Surveys in a magnetic storm: the observatory file in the settings corrects the azimuth and marks the survey."""

import dataclasses
import datetime
import os

import numpy as np
import pytest
from tool_streams import earth_field, streams

from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.pipeline.external_field import Observatory
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place
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


def _surveyed(settings):
    """The pipeline and the station of a tool at rest in the field of the settings with the storm added."""
    mat, quiet = np.broadcast_to(mat_nt(*TRUE, 0.3), (2000, 3, 3)), earth_field(5e-5, np.radians(70.0), np.radians(2.0))
    imu, mag = streams(mat, np.random.default_rng(3), field_n=quiet + 1e-9 * STORM_NT, start_ns=START)
    pipeline = Pipeline(settings)
    pipeline.push_mag(mag)
    (survey,) = pipeline.push_imu(imu).surveys + pipeline.finish().surveys
    return pipeline, survey.station


def _codes(station):
    return {reason.code for reason in station.reasons}


def test_the_storm_is_taken_off_and_the_survey_says_so(tmp_path):
    plain = changed(EstimatorSettings(), {**FIELD, "survey.north": "true"})
    with_file = changed(plain, {"place.observatory_file": _file(tmp_path / "tst.min")})
    (_, blind), (pipeline, aided) = _surveyed(plain), _surveyed(with_file)
    # 700 nT east of 17 100 nT horizontal turn the compass by 2.3 deg.
    assert abs(np.degrees(wrap_pi(blind.azimuth - TRUE[1]))) > 1.5
    assert abs(wrap_pi(aided.azimuth - TRUE[1])) < 2.0 * aided.sigma_azimuth
    assert abs(np.degrees(wrap_pi(aided.azimuth - TRUE[1]))) < 0.5
    assert ReasonCode.MAGNETIC_STORM in _codes(aided)
    assert ReasonCode.MAGNETIC_STORM in _codes(pipeline.judging_again(1)()[1].station)
    assert "observatory TST" in aided.reference.source


def test_a_time_without_data_is_said_and_the_reference_left_alone(tmp_path):
    path = _file(tmp_path / "tst.min", missing=range(310, 350))
    settings = changed(EstimatorSettings(), {**FIELD, "place.observatory_file": path})
    _, station = _surveyed(settings)
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
    _, station = _surveyed(changed(EstimatorSettings(), {**FIELD, "survey.north": "true"}))
    reference = dataclasses.replace(station.reference, external=None)
    assert observatory.at(reference, START).external is None
    _file(path)
    os.utime(path, ns=(1, 1))
    found = observatory.at(reference, START).external.strength
    assert found == pytest.approx(1e-9 * np.linalg.norm(STORM_NT), rel=1e-3)
