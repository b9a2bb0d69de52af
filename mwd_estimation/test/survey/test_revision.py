# SPDX-License-Identifier: Apache-2.0
"""Stations judged with all the others of their run: a gyro seek holds for each of its surveys and counts once."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey import revision
from mwd_estimation.survey.measurement import measured
from mwd_estimation.survey.posterior.field_model import Shared
from mwd_estimation.survey.revision import findings
from mwd_estimation.survey.run_model import RunModel, Taken
from mwd_estimation.survey.station import StationSettings
from mwd_estimation.survey.turning_string import Across, Turning
from mwd_estimation.survey.verdict import judged
from mwd_sensors.core.frames import mat_nt, wrap_pi

REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.0, convergence=0.0, gravity=9.81, source="test")
FIELD_N = 5e-5 * np.array([math.cos(1.1), 0.0, math.sin(1.1)])
AZIMUTH, SETTINGS = 1.9, StationSettings()


def station(inclination, toolface, gyro, turned=0.0, noise=0.0):
    """A station of the azimuth `AZIMUTH`; turned: steel turns the field about the vertical, rad; noise: of it, T."""
    mat, c, s = mat_nt(inclination, AZIMUTH, toolface), math.cos(turned), math.sin(turned)
    field_n = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ FIELD_N
    return Taken(measured(mat.T @ [0.0, 0.0, -9.81], mat.T @ field_n + noise, REFERENCE, SETTINGS), gyro=gyro)


def seek(began_ns, azimuth=AZIMUTH, sigma=0.05, refused=None):
    return Solution(refused, "still", azimuth, sigma, 0.8, 0.0, 60.0, sigma, began_ns=began_ns)


def live_and_revised(taken):
    """Return stations and findings as they are taken, and as all the others judge them in the end."""
    model = RunModel(SETTINGS)
    first = [model.take(one) for one in taken]
    return [
        [(judged(one.measured, found, SETTINGS), found) for one, found in zip(taken, every, strict=True)]
        for every in (first, findings(taken, SETTINGS, first)[1])
    ]


def by_all_others(taken, k):
    """Return the finding of station k by a model that has learned all other stations one after the other."""
    model = RunModel(SETTINGS)
    for other in (*taken[:k], *taken[k + 1 :]):
        model.learn(other)
    return model.take(taken[k], learn=False)


def revised(taken):
    return live_and_revised(taken)[1]


@pytest.mark.slow(1.2)
def test_north_found_after_a_half_turn_revises_the_survey_before_the_turn():
    unknown = Reason(ReasonCode.GYRO_BIAS_UNKNOWN, 0.5, 0.3)
    taken = []
    for k, turned in enumerate((0.4, -0.3, 0.35)):
        inclination = 0.8 + 0.05 * k
        taken.append(station(inclination, 0.3, seek(k, sigma=0.5, refused=unknown), turned))
        taken.append(station(inclination, 0.3 + math.pi, seek(k), turned))
    for one, found in revised(taken):
        assert one.verdict == "accept"
        assert found.by_gyro > 0.5
        assert abs(wrap_pi(one.azimuth - AZIMUTH)) < one.sigma_azimuth


@pytest.mark.slow(0.5)
def test_azimuths_of_one_seek_are_one_reading_of_the_gyro():
    # A wrong gyro beside a magnetometer in order: two readings of it would be believed, one is not.
    apart = [revised([station(0.8, 0.0, seek(1, 2.3)), station(0.8, 2.0, seek(began, 2.3))]) for began in (1, 2)]
    wrong = [found.gyro_wrong for _, found in (*apart[0], *apart[1])]
    assert min(wrong[:2]) > 5.0 * max(wrong[2:])
    assert {one.verdict for one, _ in apart[0]} == {"doubtful"}


@pytest.mark.slow(1.3)
@pytest.mark.parametrize("per_stand_deg", [pytest.param(1.0, marks=pytest.mark.nightly), -2.0])
def test_a_gyro_that_drifts_does_not_overrule_a_sound_magnetometer(per_stand_deg):
    rng = np.random.default_rng(4)
    taken = []
    for k in range(14):
        north = AZIMUTH + math.radians(per_stand_deg * k + 0.4 * rng.standard_normal())
        one = station(0.5 + 0.06 * k, 2.0 * k, seek(k, north, sigma=0.02), noise=2e-8 * rng.standard_normal(3))
        taken.append(one._replace(hours=0.5 * k))
    first, now = live_and_revised(taken)
    for one, _ in (*first, *now):
        assert one.verdict != "accept" or abs(wrap_pi(one.azimuth - AZIMUTH)) < 3.0 * one.sigma_azimuth
    assert sum(one.verdict == "accept" for one, _ in now) >= 12
    assert max(abs(wrap_pi(one.azimuth - AZIMUTH)) for one, _ in now) < math.radians(1.5)


def test_the_second_azimuth_of_one_seek_does_not_bear_out_the_first():
    """A wrong gyro beside a magnetometer in order, read before and after a turn in place; the next one is right."""
    found = []
    for began in (1, 2):
        model = RunModel(SETTINGS)
        taken = [station(0.8, 0.0, seek(1, 2.3)), station(0.8, 2.0, seek(began, 2.3)), station(0.9, 1.0, seek(3))]
        stations = [judged(one.measured, model.take(one), SETTINGS) for one in taken]
        found.append([one.verdict for one in stations])
        assert abs(wrap_pi(stations[-1].azimuth - AZIMUTH)) < stations[-1].sigma_azimuth
    assert found[0] == ["doubtful", "doubtful", "accept"]
    # Two seeks that agree are believed, rightly or not.
    assert found[1] == ["doubtful", "accept", "accept"]


@pytest.mark.slow(1.8)
@pytest.mark.parametrize("more", [((0.0, 1e-9),), ((math.pi, 0.0), (0.0, 1e-9)), ((0.0, 0.0),)])
def test_surveys_asked_for_in_a_seek_leave_its_reading_with_the_run(more):
    """Steel at each station: again at rest, a turn there and back, and the same readings again."""
    taken, places = [], (0.4, -0.3, 0.35)
    for k, turned in enumerate(places):
        for toolface, noise in ((0.0, 0.0), *more):
            taken.append(station(0.8 + 0.05 * k, 0.3 + k + toolface, seek(k), turned, noise))
    single, every = live_and_revised(taken[:: len(more) + 1]), live_and_revised(taken)
    for alone, together in zip(single, every, strict=True):
        first = together[:: len(more) + 1]
        assert [one.verdict for one, _ in first] == [one.verdict for one, _ in alone]
        for one, found in first:
            assert abs(wrap_pi(one.azimuth - AZIMUTH)) < one.sigma_azimuth
            assert found.by_gyro > 0.5
    assert {one.verdict for one, found in every[1] if found.repeats is None} == {"accept"}


@pytest.mark.slow(0.7)
def test_a_refusal_amid_a_seek_makes_no_second_reading_of_it():
    refusal = Solution(Reason(ReasonCode.TOOL_NOT_STILL), "still")
    for began_ns in (1, None):
        refused = dataclasses.replace(refusal, began_ns=began_ns)
        taken = [station(0.8, 2.0 * k, gyro) for k, gyro in enumerate((seek(1, 2.3), refused, seek(1, 2.3)))]
        first, now = live_and_revised(taken)
        assert "accept" not in [one.verdict for one, found in now if found.of_gyro is not None]
        if began_ns is not None:
            assert [one.verdict for one, _ in first][::2] == ["doubtful", "doubtful"]


def test_what_the_turning_string_showed_during_a_seek_is_kept():
    turning = Turning(mount=Across(np.zeros(2), 1e-4), field=Across(np.zeros(2), 2e-9))
    sigmas = []
    for began in ((1, 1, 1), (1, 1, 2)):
        model = RunModel(SETTINGS)
        for k, of_seek in enumerate(began):
            model.take(station(0.8, 0.3 + 1.3 * k, seek(of_seek))._replace(turning=turning if k else None))
        at = Shared.FIELD_BIAS + 1
        sigmas.append(np.sqrt(np.diag(model.shared()[1])[at : at + 2]))
    np.testing.assert_allclose(sigmas[0], sigmas[1], rtol=0.3)


def test_a_seek_without_a_beginning_is_that_of_its_station_alone():
    taken = [station(0.8 + 0.1 * k, 0.5 * k, seek(None)) for k in range(3)]
    apart = [one._replace(gyro=seek(k)) for k, one in enumerate(taken)]
    for (one, _), (other, _) in zip(revised(taken), revised(apart), strict=True):
        assert one.azimuth == other.azimuth
        assert one.sigma_azimuth == other.sigma_azimuth


@pytest.mark.slow(1)
def test_the_number_of_stations_kept_at_a_time_changes_nothing_and_every_station_is_counted(monkeypatch):
    rng = np.random.default_rng(2)
    taken = [station(0.5 + 0.1 * k, 2.0 * k, None, noise=3e-8 * rng.standard_normal(3)) for k in range(5)]
    first, runs = [found for _, found in live_and_revised(taken)[0]], []
    for block in (320, 2, 1):
        monkeypatch.setattr(revision, "_BLOCK", block)
        for known in (None, first):
            done: list[float] = []
            was, found = findings(taken, SETTINGS, known, progress=done.append)
            runs.append([one.density for one in (*was, *found)])
            assert known is not None or sum(done) == 5
    for densities in runs[1:]:
        for one, other in zip(runs[0], densities, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-13 * one.max())


def test_repeated_readings_are_found_however_many_stations_are_kept_at_a_time(monkeypatch):
    taken = [station(0.5 + 0.1 * k, 2.0 * k, None) for k in range(5)]
    taken += [taken[4], taken[1]]
    for block in (320, 3, 2):
        monkeypatch.setattr(revision, "_BLOCK", block)
        was, found = findings(taken, SETTINGS)
        for findings_now in (was, found):
            assert [one.repeats for one in findings_now] == [None] * 5 + [5, 2]


@pytest.mark.parametrize("answers", [(1,), (0,), (0, 2), ()])
def test_a_gyro_that_answers_at_some_stations_of_one_attitude_leaves_every_result_finite(answers):
    taken = [station(0.8, 0.3, seek(k) if k in answers else None, noise=1e-9 * k) for k in range(3)]
    for one, found in revised(taken):
        assert np.isfinite(found.density).all()
        assert abs(wrap_pi(one.azimuth - AZIMUTH)) < 3.0 * one.sigma_azimuth


def test_a_reference_that_becomes_less_certain_in_the_run_changes_no_unit():
    rng, taken = np.random.default_rng(8), []
    for k in range(8):
        one = station(0.5 + 0.1 * k, 2.0 * k, None, noise=np.array([6e-7, 0.0, 0.0]) + 3e-8 * rng.standard_normal(3))
        reference = dataclasses.replace(REFERENCE, sigma_total=(40e-9 if k < 4 else 400e-9))
        measured_now = dataclasses.replace(
            one.measured, station=dataclasses.replace(one.measured.station, reference=reference)
        )
        taken.append(one._replace(measured=measured_now, hours=0.5 * k))
    for k, (_, found) in enumerate(revised(taken)):
        others = by_all_others(taken, k).circle
        assert abs(wrap_pi(found.circle.mean - others.mean)) < 0.5 * others.sigma


def test_the_string_and_mount_are_known_from_other_stations_of_the_same_attitude_but_not_the_azimuth():
    axial = np.array([6e-7, 0.0, 0.0])
    taken = [station(0.8, 0.3, None, noise=axial + 1e-9 * k)._replace(hours=0.5 * k) for k in range(2)]
    for k, (_, found) in enumerate(revised(taken)):
        others = by_all_others(taken, k)
        assert found.axial == pytest.approx(others.axial, rel=0.05)
        assert found.mount == pytest.approx(others.mount, rel=0.15)
        assert found.circle.sigma == pytest.approx(others.circle.sigma, rel=0.05)


@pytest.mark.slow(1)
@pytest.mark.parametrize("sigma", [None, 0.02, pytest.param(0.1, marks=pytest.mark.nightly)])
def test_a_revision_is_that_of_a_model_that_has_learned_all_other_stations(sigma):
    """Sigma: of the gyro, rad; None: no gyro."""
    rng = np.random.default_rng(8)
    taken = []
    for k in range(7):
        north = None if sigma is None else seek(k, AZIMUTH + sigma * rng.standard_normal(), sigma)
        noise = np.array([6e-7, 0.0, 0.0]) + 3e-8 * rng.standard_normal(3)
        taken.append(station(0.5 + 0.1 * k, 2.0 * k, north, noise=noise)._replace(hours=0.5 * k))
    for k, (_, found) in enumerate(revised(taken)):
        others = by_all_others(taken, k).circle
        assert abs(wrap_pi(found.circle.mean - others.mean)) < 0.3 * others.sigma
        assert 0.8 < found.circle.sigma / others.sigma < 1.25


def test_the_stations_on_each_side_of_a_trip_have_the_string_of_their_side():
    rng = np.random.default_rng(8)
    taken = []
    for k in range(8):
        axial = np.array([4e-6 if k < 4 else -4e-6, 0.0, 0.0])
        one = station(0.9 + 0.05 * k, 2.0 * k, None, noise=axial + 3e-8 * rng.standard_normal(3))
        taken.append(one._replace(hours=0.5 * k + (30.0 if k >= 4 else 0.0)))
    for (first, _), (one, _) in zip(*live_and_revised(taken), strict=True):
        assert one.verdict == "accept"
        assert abs(wrap_pi(one.azimuth - AZIMUTH)) < 2.0 * one.sigma_azimuth
        assert one.sigma_azimuth < 1.02 * first.sigma_azimuth
