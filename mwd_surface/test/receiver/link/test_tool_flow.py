# SPDX-License-Identifier: Apache-2.0
"""Silence by flow: the tool's hold, words that refute it, and rests of a link through the earth."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, starting
from mwd_surface.receiver.flow_spans import FlowSpans, NoFlowSpan
from mwd_surface.receiver.link.link import ToolFlow

PULSES = ToolConfiguration()
THRESHOLD = PULSES.flow_threshold
CARRIER = starting("psk")
EARTH = dataclasses.replace(CARRIER, carrier=dataclasses.replace(CARRIER.carrier, medium="earth"))


def flow_of(tool, rates, pressure=None):
    """A flow to which the rig reports rates, a second apart, with a usual pressure of pumps unless it is given."""
    flow = ToolFlow(tool, FlowSpans())
    values = np.full(len(rates) + 2, 1.0e7) if pressure is None else pressure
    flow.spans.push(np.arange(len(values), dtype=float), values)
    for at_s, rate in enumerate(rates):
        flow.take(float(at_s), rate)
    return flow


def test_a_dip_that_the_tool_ignores_is_no_rest_of_a_link_through_the_earth():
    rates = [2000.0] * 20 + [0.0] * 60 + [2000.0] * 20 + [500.0] + [2000.0] * 20
    flow = flow_of(EARTH, np.array(rates) / 600.0 * THRESHOLD)
    assert flow.spans.spans == [NoFlowSpan(20.0, 80.0)]
    assert flow.on_since(120.0) == 80.0


@pytest.mark.fault_case(44)
@given(ahead=st.floats(60.0, 1e9), place=st.integers(10, 14))
def test_a_wrong_time_of_the_flow_does_not_stop_the_pumps_from_being_on(ahead, place):
    flow = flow_of(PULSES, [0.5 * THRESHOLD] * 10)
    for at_s in range(10, 40):
        flow.take(at_s + ahead * (at_s == place), 2.0 * THRESHOLD)
    assert flow.silence(40.0) == ""


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_flow_that_wavers_about_the_threshold_does_not_switch_at_each_report(seed):
    rng = np.random.default_rng(seed)
    rates = THRESHOLD * (1.03 + 0.03 * rng.standard_normal(200))
    flow = flow_of(PULSES, [])
    said = []
    for at_s, rate in enumerate(rates):
        flow.take(float(at_s), rate)
        said.append(bool(flow.silence(float(at_s))))
    assert np.count_nonzero(np.diff(said)) < 0.2 * np.count_nonzero(np.diff(rates > THRESHOLD))


def test_a_word_refutes_until_the_flow_changes_sides():
    flow = flow_of(PULSES, [0.5 * THRESHOLD] * 10)
    assert flow.silence(9.0)
    flow.take_word(5.0)
    for at_s in range(10, 400):
        flow.take(float(at_s), 0.5 * THRESHOLD)
        assert not flow.silence(float(at_s))
    for at_s in range(400, 420):
        flow.take(float(at_s), (2.0 if at_s < 410 else 0.5) * THRESHOLD)
    assert flow.silence(419.0)


@pytest.mark.parametrize(("share", "silent"), [(0.0, False), (0.1, False), (0.5, True)])
def test_a_flow_that_cannot_give_the_pressure_of_pumps_is_a_fault_of_its_meter(share, silent):
    flow = flow_of(PULSES, [share * THRESHOLD] * 10)
    assert bool(flow.silence(9.0)) is silent
    assert flow.contradiction(9.0).endswith("look at the flow meter") is not silent


def test_pumps_without_pressure_are_said_unless_the_flow_is_just_changing():
    pressure = np.where(np.arange(32) < 20, 1.0e7, 0.0)
    flow = flow_of(PULSES, [2.0 * THRESHOLD] * 30, pressure)
    assert flow.silence(29.0).endswith("look at the gauge and its valve")
    flow.take(30.0, 0.0)
    assert flow.silence(30.0).startswith("the pumps are off")


@pytest.mark.parametrize("last", [None, float("nan")])
def test_a_rate_counts_no_more_when_it_is_taken_back_or_old(last):
    flow = flow_of(PULSES, [0.5 * THRESHOLD] * 10)
    assert flow.silence(10.0)
    assert not flow.silence(60.0)
    flow.take(10.0, last)
    assert not flow.silence(10.0)
