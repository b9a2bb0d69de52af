"""Stations that accumulate in a run: refused while too few, corrected once they show the tool's own errors."""

import math

import numpy as np
import pytest

from mwd_estimation.core.reason_text import text
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.run_history import Params, StationRun
from mwd_estimation.survey.station import StationSettings, station
from mwd_sensors.core.frames import mat_nt, wrap_pi

REFERENCE = Reference(total=5e-5, dip=1.2, declination=0.0, gravity=9.81, source="test")
FIELD_N = 5e-5 * np.array([math.cos(1.2), 0.0, math.sin(1.2)])
SETTINGS = StationSettings(azimuth_method="raw")


def shot(inclination_deg, azimuth_deg, toolface, own=(9e-7, 1e-7, -8e-8), seed=0):
    rng = np.random.default_rng(seed)
    mat = mat_nt(math.radians(inclination_deg), math.radians(azimuth_deg), toolface)
    f_t = -mat.T @ [0.0, 0.0, 9.81] + 1e-3 * rng.normal(size=3)
    b_t = mat.T @ FIELD_N + np.array(own) + 1e-8 * rng.normal(size=3)
    return station(f_t, b_t, REFERENCE, SETTINGS)


def run_of(n, **changes):
    run = StationRun(Params(**changes))
    shots = [shot(20.0 + 6.0 * k, 60.0 + 4.0 * k, 2.4 * k, seed=k) for k in range(n)]
    return run, shots, [run.take(one, SETTINGS) for one in shots]


def test_too_few_stations_are_named_as_the_reason():
    _, _, taken = run_of(3)
    for k, (one, analysis) in enumerate(taken):
        assert analysis is None
        assert text(one.by_method("msa").refused) == f"too few stations in this run: {k + 1} of 4"
        assert one.method == "raw"


def test_a_build_frees_the_azimuth_of_axial_and_cross_axial_field():
    _, shots, taken = run_of(10)
    last, analysis = taken[-1]
    assert analysis is not None
    assert analysis.estimate[0] == pytest.approx(9e-7, abs=3.0 * analysis.sigma[0])
    truth = math.radians(60.0 + 4.0 * 9)
    assert abs(wrap_pi(last.azimuth - truth)) < 0.3 * abs(wrap_pi(shots[-1].azimuth - truth))
    assert abs(wrap_pi(last.azimuth - truth)) < 3.0 * last.by_method("msa").sigma
    assert last.method == "msa"


def test_one_attitude_over_and_over_shows_nothing_and_says_so():
    run = StationRun(Params())
    taken = [run.take(shot(88.0, 90.0, 0.3, seed=k), SETTINGS) for k in range(6)]
    one, analysis = taken[-1]
    assert analysis is None
    assert "take stations at other azimuths or a gyro" in text(one.by_method("msa").refused)
    assert one.method == "raw"


def test_a_gyro_at_the_stations_before_shows_what_one_east_west_attitude_hides():
    errors, sigmas = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        run, common = StationRun(Params()), math.radians(0.3) * rng.normal()
        for k in range(8):
            one, analysis = run.take(shot(88.0, 90.0, 0.8 * k, seed=100 * seed + k), SETTINGS)
            run.add_gyro(math.radians(90.0 + rng.normal()) + common, math.radians(1.0), math.radians(0.3))
        assert analysis is not None
        assert one.method == "msa"
        errors.append(float(wrap_pi(one.by_method("msa").azimuth - math.radians(90.0))))
        sigmas.append(one.by_method("msa").sigma)
        # It follows the gyro, but for what the prior holds back.
        assert 0.5 < analysis.by_gyro[-1] < 1.0
    # Seven gyro azimuths of one degree and .3 deg in common, where the field alone is refused (test above).
    assert np.degrees(np.mean(sigmas)) < 0.75
    # Chi-square, 20 degrees of freedom: 99 % band.
    assert 0.37 < np.mean(np.square(errors) / np.square(sigmas)) < 2.0


def test_a_station_taken_while_moving_or_without_a_field_is_left_out():
    run, _, _ = run_of(4)
    moved = station([0.0, 0.0, 9.0], FIELD_N, REFERENCE, SETTINGS)
    blind = station([0.0, 0.0, 9.81], [np.nan] * 3, REFERENCE, SETTINGS)
    for one in (moved, blind):
        assert run.take(one, SETTINGS) == (one, None)


def test_without_reference_or_when_switched_off_nothing_is_analysed():
    plain = station([-5.0, 0.0, 8.4], FIELD_N, None, SETTINGS)
    assert StationRun(Params()).take(plain, SETTINGS) == (plain, None)
    _, shots, taken = run_of(5, enabled=False)
    assert [one for one, _ in taken] == shots
