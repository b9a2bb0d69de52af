"""A station's azimuths weighed: what carries it, what is only compared, and what becomes of its verdict."""

import dataclasses
import math

import numpy as np
import pytest

from mwd_estimation.core.reason_text import joined, text, texts
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey import azimuth_fusion
from mwd_estimation.survey.gyro_evidence import chosen_by_field
from mwd_estimation.survey.station import MethodAzimuth, StationSettings, station
from mwd_estimation.survey.station_azimuth import weigh
from mwd_sensors.core.frames import magnetic_toolface, mat_nt, wrap_pi

DEG = math.radians(1.0)
ALARM = Reason(ReasonCode.DISAGREES_EXTERNAL_INTERFERENCE, 0.4, 3.0, (8.0,), ("raw", "gyro"))
HIDDEN = Reason(ReasonCode.INTERFERENCE_HIDDEN, 0.1)
REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.1, gravity=9.81, source="test")
FIELD_N = 5e-5 * np.array([math.cos(1.1) * math.cos(0.1), math.cos(1.1) * math.sin(0.1), math.sin(1.1)])


def shot(inclination_deg=50.0, azimuth_deg=40.0, turned_deg=0.0, **given):
    """A station; `turned_deg`: interference turns the field about the vertical; total and dip are kept."""
    mat = mat_nt(inclination_deg * DEG, azimuth_deg * DEG, 0.5)
    c, s = math.cos(turned_deg * DEG), math.sin(turned_deg * DEG)
    field = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ FIELD_N
    return station(mat.T @ [0.0, 0.0, -9.81], mat.T @ field, REFERENCE, StationSettings(), **given)


def gyro(azimuth_deg, sigma_deg, reason=None):
    return Solution(reason, "still", azimuth_deg * DEG, sigma_deg * DEG, 50 * DEG, 0.0, 60.0, 0.001)


def test_without_a_gyro_the_station_s_own_choice_stands():
    alone = shot()
    found = weigh(alone, alone, None)
    assert found.station.azimuth == pytest.approx(alone.azimuth)
    assert found.station.method == alone.method
    assert found.weights[alone.method] == 1.0
    assert found.alarm is None


def test_gyro_and_magnetic_azimuth_that_agree_are_weighed_by_their_covariance():
    alone = shot()
    found = weigh(alone, alone, gyro(40.3, 0.5))
    assert found.alarm == ()
    assert found.station.method == "fused"
    assert sum(found.weights.values()) == pytest.approx(1.0)
    assert found.weights["gyro"] > found.weights[alone.method] > 0.0
    assert found.station.sigma_azimuth < math.hypot(0.5 * DEG, math.sqrt(alone.alignment[1, 1]))
    assert 40.0 < math.degrees(found.station.azimuth) < 40.3


def test_external_interference_that_keeps_total_and_dip_is_an_alarm_and_the_gyro_carries_the_station():
    alone = shot(turned_deg=22.0)
    assert alone.verdict == "accept"
    found = weigh(alone, alone, gyro(40.0, 1.0))
    assert found.station.verdict == "doubtful"
    assert "gyro is used" in joined(found.alarm)
    assert found.station.reasons[0] == found.alarm[0]
    assert found.weights["gyro"] == 1.0
    assert abs(wrap_pi(found.station.azimuth - 40.0 * DEG)) < 1e-9
    assert found.reasons[alone.method]


def test_after_such_an_alarm_a_station_the_gyro_has_not_seen_is_doubtful():
    alone = shot(turned_deg=22.0)
    silent = Solution(Reason(ReasonCode.SEEK_TOO_SHORT, 5.0, 30.0), "auto")
    before, after = weigh(alone, alone, silent), weigh(alone, alone, silent, last_alarm=(ALARM,))
    assert before.station.verdict == "accept"
    assert f"magnetic azimuth not compared with the gyro: {text(silent.reason)}" in texts(before.station.reasons)
    assert after.station.verdict == "doubtful"
    assert "not confirmed by the gyro" in text(after.station.reasons[0])
    assert after.alarm is None
    assert after.station.azimuth == pytest.approx(alone.azimuth)


@pytest.mark.parametrize("lacks", [ReasonCode.GYRO_BIAS_UNKNOWN, ReasonCode.TWO_AZIMUTHS_FIT_GYRO])
def test_an_azimuth_that_half_a_turn_would_let_the_gyro_judge_is_doubtful_unless_settings_accept_it(lacks):
    alone = shot(turned_deg=22.0)
    refused = Reason(lacks, 25.0 * DEG, 20.0 * DEG, (0.1, 0.2))
    coarse = dataclasses.replace(gyro(60.0, 25.0), reason=refused, limit=1.4 * DEG)
    found = weigh(alone, alone, coarse)
    assert found.station.verdict == "doubtful"
    assert text(found.station.reasons[0]) == f"magnetic azimuth not compared with the gyro: {text(refused)}"
    assert found.station.azimuth == pytest.approx(alone.azimuth)
    assert found.weights["gyro"] == 0.0
    assert found.alarm is None
    # A gyro too noisy to judge in any position, and a setting that mutes that remark.
    for other in (
        weigh(alone, alone, dataclasses.replace(coarse, limit=12.0 * DEG)),
        weigh(alone, alone, coarse, azimuth_fusion.Settings(unconfirmed="accept")),
    ):
        assert other.station.verdict == "accept"
        assert found.station.reasons[0] in other.station.reasons


def test_the_magnetometer_tells_which_of_two_azimuths_that_fit_the_gyro_is_meant_where_it_can():
    alone = shot(turned_deg=22.0)
    magnetic = math.degrees(alone.azimuth)
    two_fit = Reason(ReasonCode.TWO_AZIMUTHS_FIT_GYRO, 1.0, 0.1, (0.7, 3.9))
    two = dataclasses.replace(gyro(magnetic + 90.0, 60.0, two_fit), choices=((40.0 * DEG, 0.03), (225.0 * DEG, 0.04)))
    one = chosen_by_field(two, alone)
    assert (one.success, one.reason, one.azimuth, one.sigma) == (True, None, 40.0 * DEG, 0.03)
    # It chooses, and is then judged by what it has chosen.
    assert "gyro is used" in joined(weigh(alone, alone, one).alarm)
    for choices in (((20.0 * DEG, 0.03), (100.0 * DEG, 0.03)), ((150.0 * DEG, 0.03), (300.0 * DEG, 0.03)), ()):
        near = dataclasses.replace(two, choices=choices)
        assert chosen_by_field(near, alone) is near
    assert chosen_by_field(None, alone) is None
    assert chosen_by_field(None, alone) is None


def test_a_multi_station_azimuth_is_weighed_with_the_one_of_the_same_reading():
    alone = shot()
    refused = MethodAzimuth("msa", math.nan, math.nan, Reason(ReasonCode.TOO_FEW_STATIONS, 1.0, 4.0))
    together = dataclasses.replace(alone, azimuths=(*alone.azimuths, refused))
    found = weigh(alone, together, None)
    assert found.weights["msa"] == 0.0
    assert found.reasons["msa"] == refused.refused
    good = MethodAzimuth("msa", alone.azimuth + 0.1 * DEG, 0.45 * DEG)
    together = dataclasses.replace(alone, azimuths=(*alone.azimuths, good), method="msa", corrected=True)
    found = weigh(alone, together, None)
    assert found.weights["msa"] > 0.9
    assert found.station.azimuth == pytest.approx(good.azimuth, abs=0.01 * DEG)
    assert sum(weigh(alone, together, gyro(40.0, 0.5)).weights.values()) == pytest.approx(1.0)


def test_doubts_of_the_magnetic_azimuth_alone_go_where_the_gyro_carries_the_station():
    alone = dataclasses.replace(
        shot(),
        verdict="doubtful",
        reasons=(HIDDEN,),
        azimuth_doubts=(HIDDEN,),
    )
    found = weigh(alone, alone, gyro(41.0, 1.0))
    assert found.station.verdict == "accept"
    assert found.weights["gyro"] == 1.0
    assert HIDDEN in found.station.reasons
    assert weigh(alone, alone, None).station.verdict == "doubtful"


def test_a_station_without_magnetometer_takes_the_gyro_azimuth():
    alone = station([-6.0, 1.0, 7.7], [np.nan] * 3, REFERENCE)
    found = weigh(alone, alone, gyro(40.0, 1.0))
    assert found.station.azimuth == pytest.approx(40.0 * DEG)
    assert found.station.method == "gyro"
    assert found.alarm is None
    assert (alone.verdict, found.station.verdict) == ("reject", "accept")
    assert text(found.station.reasons[0]) == "no magnetometer reading: azimuth by the gyro alone"
    # The scribe line's direction in the horizontal plane follows from the three angles.
    again = mat_nt(found.station.inclination, found.station.azimuth, found.station.gravity_toolface)
    assert found.station.magnetic_toolface == pytest.approx(float(magnetic_toolface(again)))
    weak = station([-6.2, 1.0, 8.1], [np.nan] * 3, REFERENCE)
    assert weigh(weak, weak, gyro(40.0, 1.0)).station.verdict == "reject"


def test_a_multi_station_azimuth_that_holds_the_gyro_s_lasting_error_is_not_taken_for_a_second_opinion():
    alone = shot()
    own = MethodAzimuth("msa", 40.0 * DEG, 0.75 * DEG)
    together = dataclasses.replace(alone, azimuths=(*alone.azimuths, own), azimuth=own.azimuth, method="msa")
    tied = weigh(alone, together, gyro(40.2, 0.5), aided=1.0)
    # The declination, which was in it twice, is in it no more; what it errs by the gyro errs by: no average of the two.
    sigma = math.sqrt(0.75**2 - 2.0 * 0.453**2) * DEG
    assert tied.station.by_method("msa").sigma == pytest.approx(sigma, rel=1e-3)
    assert tied.station.sigma_azimuth == pytest.approx(math.hypot(sigma, math.sqrt(alone.alignment[1, 1])), rel=0.03)
    assert tied.weights["msa"] > 0.75
    assert tied.weights["gyro"] == 0.0
    assert tied.alarm == ()


def test_a_gyro_too_uncertain_to_contradict_leaves_a_far_azimuth_open():
    alone = shot()
    far, near, certain = (
        weigh(alone, alone, gyro(azimuth, sigma)) for azimuth, sigma in ((65, 11), (55, 11), (41, 0.6))
    )
    assert far.station.verdict == "doubtful"
    assert "not certain enough to say which is right" in text(far.station.reasons[0])
    assert far.alarm == ()
    # Either may be right: the sigma covers both.
    apart = abs(far.station.azimuth - 65.0 * DEG)
    assert far.left_open == pytest.approx(apart, abs=0.2 * DEG)
    assert apart < far.station.sigma_azimuth < 1.1 * apart
    assert near.left_open == certain.left_open == 0.0
    assert near.station.verdict == certain.station.verdict == "accept"


def test_a_station_that_an_uncertain_gyro_carries_alone_is_doubtful():
    alone = station([-6.0, 1.0, 7.7], [np.nan] * 3, REFERENCE)
    found = weigh(alone, alone, gyro(40.0, 11.5))
    assert found.station.verdict == "doubtful"
    assert "good to 11.5 deg, limit 4.0 deg" in text(found.station.reasons[0])
    assert weigh(alone, alone, gyro(40.0, 3.0)).station.verdict == "accept"
