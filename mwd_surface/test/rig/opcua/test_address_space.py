# SPDX-License-Identifier: Apache-2.0
"""OPC UA variables: names, units by their codes, and a status code for each condition."""

import dataclasses

import pytest
from example_rig import NOW_NS, attitude, values
from example_surveys import S

from mwd_estimation.core.status import Status
from mwd_surface.rig.opcua.address_space import STATUS_CODES, VARIABLES, unit_id, variable_values
from mwd_surface.rig.values import Condition, nothing_yet
from mwd_surface.signals.table import TO_RIG
from mwd_surface.signals.units import UNITS

ASKED = (
    "Inclination",
    "Azimuth",
    "GravityToolface",
    "MagneticToolface",
    "ToolfaceMode",
    "TotalGravity",
    "TotalMagneticField",
    "MagneticDip",
    "SurveyMeasuredDepth",
    "SurveySequence",
    "SurveyQuality",
    "InclinationSigma",
    "AzimuthSigma",
    "ToolfaceAge",
    "AxialInterference",
    "ToolTemperature",
    "Heartbeat",
)


def test_every_variable_of_the_manifest_is_there_once_and_read_at_every_moment():
    names = [v.name for v in VARIABLES]
    assert set(ASKED) <= set(names)
    assert len(set(names)) == len(names)
    for table in (values(), values(later=100.0), values(active=False), nothing_yet()):
        assert set(variable_values(table)) == set(names)


def test_every_quantity_is_published():
    numbers = {variable.name for variable in VARIABLES if variable.kind == "Double"}
    assert numbers == {signal.opcua for signal in TO_RIG} | {"ToolfaceAge"}


@pytest.mark.parametrize(("unit", "number"), [("rad", 4405297), ("m", 5067858), ("T", 4469555), ("degC", 4408652)])
def test_a_unit_has_the_number_of_its_common_code(unit, number):
    assert unit_id(unit) == number


def test_every_unit_used_has_a_code():
    assert {v.unit for v in VARIABLES if v.unit} <= set(UNITS)


def test_every_condition_has_its_status_code():
    assert set(STATUS_CODES) == set(Condition)
    from asyncua import ua

    names = {
        Condition.GOOD: "Good",
        Condition.OVERRIDE: "GoodLocalOverride",
        Condition.WAITING: "BadWaitingForInitialData",
        Condition.DOUBTFUL: "UncertainSensorNotAccurate",
        Condition.STALE: "UncertainLastUsableValue",
        Condition.FAULT: "BadSensorFailure",
        Condition.NO_LINK: "BadNoCommunication",
        Condition.INACTIVE: "BadOutOfService",
    }
    for condition, name in names.items():
        assert getattr(ua.StatusCodes, name) == STATUS_CODES[condition]


def test_values_carry_the_time_of_their_measurement():
    table = values()
    now = variable_values(table)
    assert now["Inclination"].stamp_ns == table.survey.result.stamp_ns
    assert now["GravityToolface"].stamp_ns == NOW_NS - S // 10
    assert (now["Inclination"].value, now["Inclination"].status) == (table.survey.value("inclination"), 0)


def test_a_turning_string_makes_the_toolface_uncertain_and_says_so():
    now = variable_values(values(sample=attitude(Status.ROTATING)))
    assert now["GravityToolface"].status == STATUS_CODES[Condition.DOUBTFUL]
    assert now["Rotating"].value is True


def test_an_age_stays_good_while_the_toolface_grows_old():
    now = variable_values(values(later=30.0))
    assert now["GravityToolface"].status == STATUS_CODES[Condition.NO_LINK]
    assert now["ToolfaceAge"].status == 0
    assert now["ToolfaceAge"].value == pytest.approx(30.1)


def test_what_the_rig_does_not_say_is_waiting_not_false():
    table = dataclasses.replace(values(), circulating=None, in_slips=None)
    now = variable_values(table)
    assert {now[n].status for n in ("Circulating", "InSlips")} == {STATUS_CODES[Condition.WAITING]}
