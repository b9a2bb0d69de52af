# SPDX-License-Identifier: Apache-2.0
"""Bundled scenarios without a fault: nearly all their surveys are accepted, and what is accepted of them is right."""

from __future__ import annotations

import dataclasses

import pytest

from mwd_sensors.simulator import scenario
from project import SCENARIOS
from simulated_surveys import revised_surveys, surveys

# Steel beside the hole, and a string magnetised by 20 uT: how much is accepted there depends on them.
DISTURBED = ("casing", "s0_table")
UNDETERMINED = ("near_polar",)  # an inclined hole where the field does not determine the azimuth

# Sensor faults, an uncalibrated probe, a run without a rest; a field turned with its total and dip kept, of which a
# test below says more; and the run that `test_tool_comparison.py` compares with the tables of its paper.
OTHERS = ("faults", "tumble", "s3_vibration", "s1_field", "s1_lab")
# Another link, pump, seed or depth in a hole that is played: `make nightly` plays them.
SAME_HOLE = (
    "telemetry_bad_day",
    "telemetry_downlink",
    "telemetry_em_clay",
    "telemetry_em_salt",
    "telemetry_pumps",
    "telemetry_serial",
    "telemetry_shallow",
    "telemetry_siren",
    "telemetry_two_links",
)
NAMES = sorted(path.stem for path in SCENARIOS.glob("*.yaml") if path.stem not in (*OTHERS, *SAME_HOLE))
# A rig's hour and a quarter repeats one stand and one connection: twice says what five times do.
CYCLES = {"connections": 2, "mine_hole": 2, "curve_and_lateral": 10}
# A part of the schedule that lasts longer than this, s, ends then.
LONGEST_S = 40.0


def played(name):
    """The scenario in less time: what is drilled or slid is drilled as far, which leads to the same station."""
    story = scenario.read(SCENARIOS / f"{name}.yaml")
    cycles = min(story.cycles, CYCLES.get(name, story.cycles))
    stands = 3.0 if name == "curve_and_lateral" else 1.0
    parts = []
    for part in story.schedule:
        seconds = min(part.seconds, LONGEST_S)
        parts.append(dataclasses.replace(part, seconds=seconds, rop_m_h=stands * part.rop_m_h * part.seconds / seconds))
    return dataclasses.replace(story, cycles=cycles, schedule=tuple(parts))


@pytest.mark.slow(1)
@pytest.mark.parametrize("name", [*NAMES, *(pytest.param(name, marks=pytest.mark.nightly) for name in SAME_HOLE)])
def test_a_bundled_scenario_without_a_fault_has_its_surveys_accepted_and_right(name):
    found = surveys(played(name))
    assert found
    # Where the hole is vertical, or the field too steep, a survey is accepted with its azimuth not determined.
    if name in UNDETERMINED:
        assert all(one.survey.station.verdicts.azimuth == "doubtful" for one in found)
    elif name not in DISTURBED:
        assert sum(one.survey.station.verdict == "accept" for one in found) >= 0.95 * len(found)
    assert sum(one.accepted_for_inclination for one in found) >= 0.95 * len(found)
    for one in found:
        assert not one.accepted or abs(one.azimuth_error) < 3.0 * one.sigma_azimuth
        assert not one.accepted_for_inclination or abs(one.inclination_error) < 3.0 * one.sigma_inclination


@pytest.mark.slow
def test_a_collar_magnetised_across_its_axis_is_known_before_the_first_station():
    """The field across the axis turns the azimuth by 1 to 3 deg, and nothing in the readings of a station shows it."""
    story = scenario.read(SCENARIOS / "connections.yaml")
    short = tuple(dataclasses.replace(part, seconds=min(part.seconds, 100.0)) for part in story.schedule)
    collar = dataclasses.replace(story.interference, cross_nt=(1100.0, -700.0))
    (one,) = surveys(dataclasses.replace(story, cycles=1, schedule=short, interference=collar))
    assert one.accepted
    assert abs(one.azimuth_error) < 3.0 * one.sigma_azimuth
    odds = dict(one.survey.station.hypotheses)
    assert odds["cross_axial"] > 0.9


@pytest.mark.slow(9)
@pytest.mark.parametrize(
    ("depths", "rest_s"), [([30, 60], 60.0), pytest.param([30, 60, 90], 150.0, marks=pytest.mark.nightly)]
)
def test_s1_field_case_is_accepted_by_its_gyro(depths, rest_s):
    """Steel turns the field by some 20 deg and keeps total and dip: only a gyro in two positions shows the azimuth."""
    story = scenario.read(SCENARIOS / "s1_field.yaml")
    # A station is a rest, half a turn and a rest; a move leads to the next.
    parts = (dataclasses.replace(p, seconds=min(p.seconds, rest_s)) for p in story.schedule[: 4 * len(depths) - 1])
    first, last = revised_surveys(dataclasses.replace(story, schedule=tuple(parts)))
    # Two at each depth, before and after half a turn; none while the string is moved.
    assert [round(one.measured_depth) for one in first] == [depth for depth in depths for _ in range(2)]
    # In a string of steel the first says that it does not know. From half a turn on the gyro is believed; before it,
    # the biases may have changed since the station above.
    assert first[0].survey.station.verdict == "doubtful"
    assert abs(first[0].azimuth_error) < 3.0 * first[0].sigma_azimuth
    for one in (*first[1::2], *last):
        assert one.accepted
        assert one.survey.weights["gyro"] > 0.5
        assert abs(one.azimuth_error) < 3.0 * one.sigma_azimuth < 0.2
