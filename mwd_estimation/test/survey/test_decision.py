# SPDX-License-Identifier: Apache-2.0
"""The decision on a survey: rewording changes nothing; a fault and a rotating string have their effect."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import mwd_estimation.survey
from mwd_estimation.attitude.gyro_azimuth_filter import PropagatedAzimuth
from mwd_estimation.core import reason_text
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.time_bins import Average
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.decision import SurveyDecision
from mwd_estimation.survey.fault_history import Accusation, FaultHistory
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station import StationSettings
from mwd_estimation.survey.survey import ROTARY
from mwd_sensors.core.frames import mat_nt, wrap_pi

REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.05, convergence=0.01, gravity=9.81, source="test")
FIELD_N = 5e-5 * np.array([math.cos(1.1) * math.cos(0.05), math.cos(1.1) * math.sin(0.05), math.sin(1.1)])
REFUSALS = (ReasonCode.GYRO_BIAS_UNKNOWN, ReasonCode.TWO_AZIMUTHS_FIT_GYRO, ReasonCode.SEEK_TOO_SHORT)
NOTHING = PropagatedAzimuth(*[math.nan] * 5)


def average(k, inclination, azimuth, axial=0.0, turned=0.0, mag=True, scale=1.0):
    """A still interval; turned: external interference turns the field about the vertical, rad; scale: of the force."""
    mat = mat_nt(inclination, azimuth, 0.7 * k)
    c, s = math.cos(turned), math.sin(turned)
    field = mat.T @ (np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ FIELD_N) + [axial, 0.0, 0.0]
    imu = Average(np.concatenate([np.zeros(3), scale * (mat.T @ [0.0, 0.0, -9.81])]), 4e-6 * np.eye(6), 800)
    read = Average(field, 9e-16 * np.eye(3), 800) if mag else None
    return StillAverage(10**11 * k, 10**11 * k + 10**10, imu, read, None, None, requested=False)


def decision(faults=None):
    return SurveyDecision(StationSettings(), faults or FaultHistory())


def by_gyro(azimuth, sigma=0.01, *, limit=None, inclination=0.8, method="still", refused=None, **more):
    """Return the solution of a north seek of a minute."""
    return Solution(refused, method, azimuth, sigma, inclination, 0.0, 60.0, limit or sigma, **more)


def taken(decide, k, inclination, azimuth, *, gyro=None, known=NOTHING, **errors):
    """The k-th survey of a run with these errors of the readings; known: the azimuth that the gyros carried there."""
    return decide.complete(decide.begin(average(k, inclination, azimuth, **errors), k, REFERENCE, gyro), known)


def drawn_run(seed):
    """Surveys of a run drawn at random: interference of all kinds, a gyro that finds north, refuses it or is silent."""
    rng = np.random.default_rng(seed)
    faults, surveys = FaultHistory(), []
    # The accelerometer is in doubt during the last survey.
    faults.doubt(np.array([605, 606]) * 10**9, np.array([2, 2], dtype=np.uint8))
    decide = decision(faults)
    inclination, azimuth = rng.uniform(0.01, 1.8), rng.uniform(0.0, 2.0 * math.pi)
    axial = rng.normal() * rng.choice([2e-7, 3e-6, 2e-5])
    for k in range(6):
        azimuth += rng.uniform(0.0, 0.1)
        turned, scale = rng.choice([0.0, 0.0, 0.4]), rng.choice([1.0, 1.0, 1.0, 1.01])
        still = average(k + 1, inclination, azimuth, axial, turned, rng.random() > 0.1, scale)
        refused = Reason(rng.choice(REFUSALS), 0.3, 0.1, (0.2, 0.4)) if rng.random() < 0.4 else None
        choices = ((azimuth, 0.03), (math.pi - azimuth, 0.03)) if rng.random() < 0.5 else ()
        sigma, limit = rng.choice([0.005, 0.05, 0.2]), rng.choice([0.002, 0.2])
        gyro = by_gyro(azimuth, sigma, limit=limit, inclination=inclination, refused=refused, choices=choices)
        begun = decide.begin(still, k + 1, REFERENCE, gyro if rng.random() < 0.8 else None)
        here, before = azimuth + rng.normal(0.0, 0.05, 2)
        propagated = PropagatedAzimuth(before, 0.02, 0.005, here, 0.02)
        surveys.append((begun, decide.complete(begun, propagated if rng.random() < 0.7 else NOTHING)))
    return surveys


@pytest.mark.slow
def test_rewording_every_reason_changes_no_survey_verdict_azimuth_or_sigma(monkeypatch):
    plain = [drawn_run(seed) for seed in range(3)]
    records = [survey.record() for run in plain for _, survey in run]
    for code in ReasonCode:
        monkeypatch.setitem(reason_text.WORDS, code, "reworded")
    again = [drawn_run(seed) for seed in range(3)]
    assert repr(again) == repr(plain)
    reworded = [survey.record() for run in again for _, survey in run]
    assert {record.verdict for record in records} == {0, 1, 2}
    for one, other in zip(reworded, records, strict=True):
        assert set(one.reasons) == {"reworded"}
        assert one.verdict == other.verdict
        np.testing.assert_array_equal(one.covariance, other.covariance)


def test_only_the_record_of_a_survey_makes_words_of_reasons():
    folder = Path(mwd_estimation.survey.__file__).parent
    named = {path.name for path in folder.glob("*.py") if "reason_text" in path.read_text()}
    assert named == {"decided_survey.py", "survey.py"}


def test_a_survey_of_a_rotating_string_has_no_toolface():
    survey = decision().rotary(average(1, 0.8, 1.9), 3, REFERENCE, -2.0)
    assert survey.kind == ROTARY
    assert math.isnan(survey.station.gravity_toolface)
    assert math.isnan(survey.station.sigma_toolface)
    assert survey.station.verdicts.toolface == "not_determined"
    assert survey.station.reasons[-1] == Reason(ReasonCode.STRING_ROTATED, 2.0)


@pytest.mark.parametrize("sound", [True, False])
def test_nothing_is_learnt_from_a_survey_taken_during_a_fault(sound):
    begun = decision().begin(average(1, 0.8, 1.9), 1, REFERENCE, by_gyro(1.9, limit=0.001))
    begun = dataclasses.replace(begun, against=None if sound else Accusation("reject", (), True))
    assert math.isfinite(begun.gyro[0]) == math.isfinite(begun.accepted_azimuth.azimuth) == sound


@pytest.mark.slow
def test_gyro_readings_revise_an_earlier_station_beside_steel_and_its_first_value_stays():
    decide, rng, published, azimuths = decision(), np.random.default_rng(3), [], 1.9 + 0.02 * np.arange(7)
    for k, azimuth in enumerate(azimuths):
        # Steel turns the field and keeps total and dip; the gyro answers from the second station on.
        found, turned = by_gyro(azimuth + rng.normal(0.0, 0.02), 0.03), 0.4 if k != 3 else -0.3
        survey = taken(decide, k + 1, 0.8 + 0.02 * k, azimuth, turned=turned, gyro=found if k else None)
        published.append(survey.station)
    revised = decide.revisions()
    assert published[0].verdicts.azimuth == "accept"
    assert revised[1].station.verdicts.azimuth == "doubtful"
    now = [revised[k + 1].station if k + 1 in revised else one for k, one in enumerate(published)]
    # The gyro has no share in what the magnetometer says, and the other way round.
    assert math.isclose(sum(revised[1].weights.values()), 1.0)
    for station, azimuth in zip(now, azimuths, strict=True):
        error = abs(wrap_pi(station.azimuth - azimuth))
        assert station.verdicts.azimuth != "accept" or error < 3.0 * station.sigma_azimuth
    assert sum(one.verdicts.azimuth == "accept" for one in now) >= 5


@pytest.mark.slow
def test_the_newest_stations_of_a_run_are_revised_by_all_the_others():
    decide = decision()
    for k in range(5):
        # Nothing but the gyro shows that the field is turned, and it answers from the second station on.
        taken(decide, k + 1, 0.5 + 0.1 * k, 1.9, turned=0.4, gyro=by_gyro(1.9) if k else None)
    every, newest = decide.judging_again(5)(), decide.judging_again(4)()
    assert every[1].station.verdict == decide.revisions()[1].station.verdict == "doubtful"
    assert list(newest) == [2, 3, 4, 5]
    assert [every[n].station.verdict for n in newest] == [one.station.verdict for one in newest.values()]


@pytest.mark.slow
def test_a_revised_station_lists_the_azimuth_that_its_seek_of_the_gyro_had_in_the_end():
    decide, unknown = decision(), Reason(ReasonCode.GYRO_BIAS_UNKNOWN, 0.5, 0.3)
    for k in range(4):
        seek = {"inclination": 0.8 + 0.05 * (k // 2), "began_ns": k // 2}
        found = by_gyro(1.9, 0.02, method="two_position", **seek) if k else by_gyro(2.4, 0.5, refused=unknown, **seek)
        taken(decide, k + 1, seek["inclination"], 1.9, turned=0.4, gyro=found)
    survey = decide.revisions()[1]
    row = survey.station.by_method(AzimuthMethod.GYRO)
    assert survey.weights[AzimuthMethod.GYRO] > 0.5
    assert row.refused is None
    assert math.isclose(row.azimuth, 1.9 - REFERENCE.convergence)
    assert row.sigma == 0.02


@pytest.mark.slow
def test_a_run_without_surprises_keeps_its_verdicts_and_readings_played_again_stay_doubtful():
    decide = decision()
    for k in range(6):
        taken(decide, k + 1, 0.5 + 0.1 * k, 1.9)
    again = dataclasses.replace(average(3, 0.7, 1.9), start_ns=2 * 10**12)
    assert decide.complete(decide.begin(again, 7, REFERENCE, None), NOTHING).station.verdict == "doubtful"
    revised = decide.revisions()
    assert 7 not in revised
    assert all(survey.station.verdict == "accept" for survey in revised.values())


@pytest.mark.parametrize("noise_t", [0.0, 2e-8])
def test_a_station_measured_again_teaches_nothing_and_is_doubtful_only_where_the_same_readings_come_again(noise_t):
    decide, still = decision(), average(1, 0.8, 1.9)
    first = decide.begin(still, 1, REFERENCE, None)
    mag = dataclasses.replace(still.mag, mean=still.mag.mean + noise_t * np.array([1.0, -0.5, 0.5]))
    second = decide.begin(dataclasses.replace(still, start_ns=2 * 10**12, mag=mag), 2, REFERENCE, None)
    assert first.survey.station.verdict == "accept"
    assert second.survey.station.verdict == ("accept" if noise_t else "doubtful")
    repeated = second.survey.station.headline == Reason(ReasonCode.READINGS_REPEATED, 1.0)
    assert repeated == (noise_t == 0.0)
    np.testing.assert_array_equal(second.shared[0], first.shared[0])


def test_a_run_learns_the_string_s_field_and_steel_at_one_station_leaves_no_trace():
    decide, rng, verdicts = decision(), np.random.default_rng(5), []
    for k in range(12):
        inclination, azimuth = 0.3 + 0.1 * k, 0.5 + 0.05 * k
        still = average(k + 1, inclination, azimuth, 9e-7)
        steel = np.array([3e-6, 2e-6, -2e-6]) if k == 8 else 0.0
        mag = dataclasses.replace(still.mag, mean=still.mag.mean + steel + 30e-9 * rng.normal(size=3))
        station = decide.begin(dataclasses.replace(still, mag=mag), k + 1, REFERENCE, None).survey.station
        verdicts.append(station.verdicts.azimuth)
        if k > 3 and k != 8:
            assert abs(wrap_pi(station.azimuth - (azimuth - 0.01))) < 2.0 * station.sigma_azimuth
    assert verdicts[4:] == ["accept"] * 4 + ["doubtful"] + ["accept"] * 3
    assert station.interference == pytest.approx(9e-7, abs=3.0 * station.sigma_interference)
    assert station.sigma_interference < 3e-7


def test_a_gyro_off_beside_steel_is_held_against_the_propagated_azimuth():
    def found(off):
        decide = decision()
        for k in range(3):
            decide.begin(average(k + 1, 0.8 + 0.1 * k, 0.5), k + 1, REFERENCE, by_gyro(0.51, 0.02, limit=0.015))
        beside = average(4, 1.2, 0.5)
        steel = dataclasses.replace(beside.mag, mean=beside.mag.mean + np.array([4e-6, 3e-6, -2e-6]))
        gyro = by_gyro(0.51 + off, 0.02, limit=0.015, inclination=1.2)
        begun = decide.begin(dataclasses.replace(beside, mag=steel), 4, REFERENCE, gyro)
        assert not begun.accepted_azimuth.by_gyro
        return decide.complete(begun, NOTHING._replace(station_azimuth=0.5, station_sigma=0.02)).station

    right, wrong = found(0.0), found(0.12)
    assert right.verdicts.azimuth == "accept"
    assert abs(wrap_pi(right.azimuth - 0.5)) < 0.03
    assert wrong.verdicts.azimuth == "doubtful" or abs(wrap_pi(wrong.azimuth - 0.5)) < 3.0 * wrong.sigma_azimuth


def test_a_place_typed_wrong_is_told_from_steel_and_named_first():
    decide = decision()
    wrong = dataclasses.replace(REFERENCE, total=REFERENCE.total - 3e-6, dip=REFERENCE.dip + 0.1, gravity=9.76)
    for k in range(5):
        station = decide.begin(average(k + 1, 0.4 + 0.2 * k, 0.5 + 0.1 * k), k + 1, wrong, None).survey.station
    assert station.verdicts.azimuth == "doubtful"
    assert station.headline.code == ReasonCode.FIELD_OF_ANOTHER_PLACE


def test_a_mount_that_may_be_turned_widens_the_inclination_and_makes_it_doubtful():
    def last(turn):
        decide = decision()
        for k in range(4):
            still = average(k + 1, 0.6 + 0.2 * k, 0.5)
            f_t, (c, s) = still.imu.mean[3:], (math.cos(turn), math.sin(turn))
            mean = np.concatenate([np.zeros(3), [c * f_t[0] + s * f_t[2], f_t[1], c * f_t[2] - s * f_t[0]]])
            still = dataclasses.replace(still, imu=dataclasses.replace(still.imu, mean=mean))
            station = decide.begin(still, k + 1, REFERENCE, None).survey.station
        return station

    turned, sound = last(0.03), last(0.0)
    assert turned.sigma_inclination > 1.1 * sound.sigma_inclination
    assert (turned.verdicts.inclination, sound.verdicts.inclination) == ("doubtful", "accept")
    assert ReasonCode.MOUNT_MAY_BE_TURNED in {reason.code for reason in turned.reasons}


def test_the_propagated_azimuth_chooses_between_azimuths_that_fit_and_adds_nothing_else():
    reference = Reference(total=61e-6, dip=math.radians(-70.0), declination=math.radians(13.0), gravity=9.81)
    mirror = np.array([19019.8, -14296.8, 54757.3]) * 1e-9
    imu = Average(np.array([0.0, 0.0, 0.0, -0.30117, -2.19084, 9.55549]), 1e-10 * np.eye(6), 800)
    still = StillAverage(0, 10**10, imu, Average(mirror, 1e-18 * np.eye(3), 800), None, None, requested=False)
    decide = decision()
    begun = decide.begin(still, 1, reference, None)
    near = decide.complete(begun, NOTHING._replace(station_azimuth=math.radians(8.0), station_sigma=0.01))
    alone = begun.survey.station
    assert [round(math.degrees(azimuth), -1) for azimuth, _ in alone.alternatives] == [200.0]
    assert near.station.alternatives == ()
    assert near.station.by_method("carried").azimuth == pytest.approx(math.radians(8.0))
    assert abs(wrap_pi(near.station.azimuth - math.radians(7.8))) < near.station.sigma_azimuth


@pytest.mark.parametrize("noted", [False, True])
def test_a_doubt_that_comes_after_a_survey_was_begun_changes_nothing_however_the_samples_were_cut(noted):
    faults = FaultHistory()
    decide = decision(faults)
    begun = decide.begin(average(1, 0.8, 1.9), 1, REFERENCE, None)
    if noted:
        # Later samples of the block in which the survey was begun.
        faults.doubt(np.array([112, 113]) * 10**9, np.array([2, 2], dtype=np.uint8))
    done = decide.complete(begun, PropagatedAzimuth(1.9, 0.02, 0.005, 1.9, 0.02))
    assert done.station.verdict == begun.survey.station.verdict == "accept"
    assert decide.revisions() == {}


def with_one_that_the_gyros_contradict():
    """A run of four and its stations; the third shows a turn that the gyros did not see, and nothing else is wrong."""
    decide, published = decision(), []
    for k in range(4):
        off = 0.1 if k == 2 else 0.0
        known = NOTHING if k == 0 else NOTHING._replace(station_azimuth=1.891 + 0.05 * k + off, station_sigma=0.005)
        published.append(taken(decide, k + 1, 0.8, 1.9 + 0.05 * k, known=known).station)
    return decide, published


def test_what_the_station_above_says_of_an_azimuth_is_not_forgotten_when_it_is_judged_again():
    decide, published = with_one_that_the_gyros_contradict()
    assert [one.verdict for one in published] == ["accept", "accept", "doubtful", "accept"]
    assert decide.revisions() == {}


def test_what_came_from_a_station_that_is_itself_revised_is_no_longer_held_against_the_next(monkeypatch):
    decide, published = with_one_that_the_gyros_contradict()
    whether = mwd_estimation.survey.decision.is_revised
    of_the_second = lambda first, *other: first is published[1] or whether(first, *other)  # noqa: E731
    monkeypatch.setattr(mwd_estimation.survey.decision, "is_revised", of_the_second)
    revised = decide.revisions()
    assert list(revised) == [2, 3]
    assert revised[3].station.verdict == "accept"


@pytest.mark.slow
def test_a_sound_station_is_not_held_against_one_beside_steel_once_a_gyro_has_agreed():
    decide, published = decision(), []
    for k in range(6):
        # Steel turns the first one's field alone; the gyro agrees from the second on, when it was no judge yet.
        known = NOTHING._replace(station_azimuth=published[0].azimuth, station_sigma=0.005) if k == 1 else NOTHING
        gyro, turned = (by_gyro(1.9), 0.0) if k else (None, 0.4)
        published.append(taken(decide, k + 1, 0.8, 1.891, gyro=gyro, known=known, turned=turned).station)
    assert published[1].verdict == decide.judging_again(6)()[2].station.verdict == "accept"
