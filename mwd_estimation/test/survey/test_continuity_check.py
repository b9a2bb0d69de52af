"""The azimuth carried from the last station: agrees and changes nothing, disagrees and is an alarm, or stands in."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from mwd_estimation.attitude.gyro_azimuth_state import PropagatedAzimuth
from mwd_estimation.core.reason_text import joined
from mwd_estimation.core.reasons import Reason, ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.acceptance import ACCEPT, DOUBTFUL, REJECT
from mwd_estimation.survey.azimuth_fusion import Settings
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.continuity_check import accepted_azimuth, checked
from mwd_estimation.survey.station import StationSettings, station
from mwd_estimation.survey.survey import ROTARY, Survey
from mwd_sensors.core.frames import mat_nt

DEG = math.radians(1.0)
PROPAGATED = AzimuthMethod.GYRO_PROPAGATED
REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.1, gravity=9.81, source="test")
FIELD_N = 5e-5 * np.array([math.cos(1.1) * math.cos(0.1), math.cos(1.1) * math.sin(0.1), math.sin(1.1)])
NOTHING = PropagatedAzimuth(*[math.nan] * 5)
# A declination of .37 + .22 deg in squares is in every magnetic azimuth.
LASTING = 0.4 * DEG


def taken(azimuth_deg: float = 40.0, weights: dict[str, float] | None = None, **changes) -> Survey:
    mat = mat_nt(50.0 * DEG, azimuth_deg * DEG, 0.5)
    one = station(mat.T @ [0.0, 0.0, -9.81], mat.T @ FIELD_N, REFERENCE, StationSettings())
    nothing = np.zeros((3, 3))
    return Survey(
        0, 1, "", False, 10.0, 1000, dataclasses.replace(one, **changes), nothing, nothing, np.zeros(3), None,
        weights={one.method: 1.0} if weights is None else weights,
    )  # fmt: skip


def carried(azimuth_deg: float, sigma_deg: float = 0.6) -> PropagatedAzimuth:
    return PropagatedAzimuth(azimuth_deg * DEG, sigma_deg * DEG, LASTING, math.nan, math.nan)


def test_where_nothing_is_carried_the_survey_stays_as_it_is() -> None:
    one = taken()
    assert checked(one, NOTHING, Settings()) is one
    turned = dataclasses.replace(one, kind=ROTARY)
    assert checked(turned, carried(40.0), Settings()) is turned


def test_a_carried_azimuth_that_agrees_is_listed_and_never_narrows_the_sigma() -> None:
    one = taken()
    found = checked(one, carried(40.4, 0.41), Settings())
    assert found.station.azimuth == one.station.azimuth
    assert found.station.sigma_azimuth == one.station.sigma_azimuth
    assert (found.station.verdict, found.alarm, found.weights[PROPAGATED]) == (ACCEPT, None, 0.0)
    assert found.station.by_method(PROPAGATED).sigma == pytest.approx(0.41 * DEG)
    assert found.azimuth_reasons[PROPAGATED].code == ReasonCode.PROPAGATED_AGREES


def test_external_interference_that_came_since_the_last_station_is_an_alarm_and_makes_the_station_doubtful() -> None:
    one = taken(azimuth_deg=46.0)
    found = checked(one, carried(40.0), Settings())
    assert found.station.verdict == DOUBTFUL
    assert "+6.0 deg" in joined(found.alarm)
    unresolved = dataclasses.replace(found.alarm[0], code=ReasonCode.PROPAGATED_DISAGREES_UNRESOLVED)
    assert found.station.reasons[0] == unresolved
    # Not an average: the azimuth stays, its sigma holds the difference.
    assert found.station.azimuth == one.station.azimuth
    assert 6.0 * DEG < found.station.sigma_azimuth < 6.2 * DEG


def test_a_difference_of_less_than_a_degree_is_no_alarm_however_certain_both_are() -> None:
    one = taken(azimuth_deg=40.8)
    assert not checked(one, PropagatedAzimuth(40.0 * DEG, 0.05 * DEG, 0.05 * DEG, math.nan, math.nan), Settings()).alarm


def test_what_both_errors_share_makes_a_difference_count_more() -> None:
    one = taken(azimuth_deg=42.2)
    assert checked(one, carried(40.0), Settings()).alarm
    assert not checked(one, carried(40.0)._replace(station_constant_sigma=0.0), Settings()).alarm


def test_where_a_gyro_found_north_the_station_stands_and_the_difference_is_reported() -> None:
    one = taken(azimuth_deg=46.0, weights={"raw": 0.3, "corrected": 0.0, "gyro": 0.7})
    found = checked(one, carried(40.0), Settings())
    assert found.station.verdict == ACCEPT
    assert found.station.sigma_azimuth == one.station.sigma_azimuth
    assert found.alarm
    assert set(found.alarm) <= set(found.station.reasons)


def test_a_station_whose_own_azimuth_its_check_doubts_is_given_the_carried_one_and_stays_doubtful() -> None:
    doubt = Reason(ReasonCode.FIELD_OFF, 900e-9, 300e-9)
    one = taken(azimuth_deg=46.0, verdict=DOUBTFUL, azimuth_doubts=(doubt,), reasons=(doubt,))
    found = checked(one, carried(40.0), Settings())
    assert found.station.azimuth == pytest.approx(40.0 * DEG)
    assert found.station.sigma_azimuth == pytest.approx(math.hypot(0.6 * DEG, math.sqrt(one.station.alignment[1, 1])))
    assert (found.station.method, found.station.verdict) == (PROPAGATED, DOUBTFUL)
    assert sum(found.weights.values()) == found.weights[PROPAGATED] == 1.0
    assert found.station.reasons[-1] == Reason(ReasonCode.PROPAGATED_USED, causes=(doubt,))
    assert found.station.magnetic_toolface == pytest.approx((one.station.magnetic_toolface - 6.0 * DEG) % (2 * math.pi))


def test_a_rejected_station_and_an_azimuth_hardly_known_are_only_compared() -> None:
    dip = (Reason(ReasonCode.DIP_OFF, 0.1, 0.01),)
    one = taken(azimuth_deg=46.0, verdict=REJECT, azimuth_doubts=dip, reasons=dip)
    found = checked(one, carried(40.0), Settings())
    assert (found.station.verdict, found.station.azimuth, found.weights[PROPAGATED]) == (
        REJECT,
        one.station.azimuth,
        0.0,
    )
    vague = checked(taken(azimuth_deg=46.0), carried(40.0, 50.0), Settings())
    assert (vague.station.verdict, vague.alarm) == (ACCEPT, None)
    assert vague.azimuth_reasons[PROPAGATED].code == ReasonCode.AZIMUTH_UNCERTAIN


def test_only_an_accepted_station_is_carried_on_with_its_own_sigma_and_what_it_shares() -> None:
    one = taken()
    azimuth, sigma, lasting, sought = accepted_azimuth(one)
    assert azimuth == one.station.azimuth
    assert sigma == pytest.approx(math.sqrt(one.station.covariance[1, 1] - one.station.alignment[1, 1]))
    assert lasting == pytest.approx(math.sqrt(REFERENCE.declination_variance(REFERENCE.horizontal)))
    assert sought == 0.0
    by_gyro = accepted_azimuth(taken(weights={"raw": 0.0, "gyro": 1.0}))
    assert by_gyro[2:] == (0.0, 1.0)
    for other in (taken(verdict=DOUBTFUL), dataclasses.replace(one, kind=ROTARY)):
        assert np.isnan(accepted_azimuth(other)[:3]).all()


def test_a_station_far_from_the_samples_up_to_it_is_doubtful_and_its_sigma_holds_the_difference() -> None:
    def up_to(azimuth_deg: float, sigma_deg: float = 0.6) -> PropagatedAzimuth:
        return PropagatedAzimuth(math.nan, math.nan, math.nan, azimuth_deg * DEG, sigma_deg * DEG)

    one = taken()
    far = checked(one, up_to(36.0), Settings())
    assert far.station.verdict == DOUBTFUL
    assert "+4.0 deg" in joined(far.station.reasons)
    assert far.station.azimuth == one.station.azimuth
    assert 4.0 * DEG < far.station.sigma_azimuth < 4.2 * DEG
    assert checked(one, up_to(39.2), Settings()) is one
    assert checked(one, up_to(36.0, 60.0), Settings()) is one
    by_gyro = taken(weights={"raw": 0.0, "gyro": 1.0})
    assert checked(by_gyro, up_to(36.0), Settings()) is by_gyro
