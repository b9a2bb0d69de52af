# SPDX-License-Identifier: Apache-2.0
"""The printed numbers: rounding, unknowns, the head block, and what is left out."""

import dataclasses
import math

import example_surveys as example
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.telemetry import meanings
from mwd_surface.exports import survey_table as tables
from mwd_surface.receiver.link import link_survey
from mwd_surface.receiver.link.link_survey import SurveyTime
from mwd_surface.receiver.words import LinkValue
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.plan import plan_of


def head(table):
    return dict(table.header)


def test_the_head_block_names_every_reference_and_correction():
    got = head(example.table())
    assert got["Azimuth reference"] == "grid north"
    assert (got["Declination"], got["Grid convergence"], got["Total azimuth correction"]) == (
        "1.400 deg",
        "-0.600 deg",
        "2.000 deg",
    )
    assert (got["Depth datum"], got["Datum elevation"]) == ("RKB", "25.00 m above mean sea level")
    assert got["Reference total field"] == "50300 nT"
    assert got["Surveys"] == "11 surveys in use of 12; 1 judged by a person"
    assert got["Report made"] == "2026-05-15T17:43:40.123Z"
    assert "ISCWSA MWD Rev5.11" in got["Position uncertainty"]


@pytest.mark.parametrize(
    ("links", "text"),
    [
        ((), ""),
        (("mud_pulse",), "imported list: 1 of 3, mud pulse: 1 of 3, tool's own topics: 1 of 3"),
        (
            ("em and mud_pulse", "mud_pulse"),
            "em and mud pulse: 1 of 4, imported list: 1 of 4, mud pulse: 1 of 4, tool's own topics: 1 of 4",
        ),
    ],
)
def test_the_head_block_counts_the_surveys_in_use_by_the_links_that_brought_them(links, text):
    """
    One of the tool's own topics and one as an imported list has it, without readings; then as the receiver makes them.

    The last of a link is rejected.
    """
    whole = SurveyList(well=dataclasses.replace(example.WELL, north_reference="magnetic"))
    came = ["", "", *links, "mud_pulse"] if links else ["", ""]
    for k, link in enumerate(came, 1):
        words = {meanings.INCLINATION: 0.1 * k, meanings.AZIMUTH: 1.3}
        values = {name: LinkValue(value, 1e-3, k, 0.0, 1.0, 0.99) for name, value in words.items()}
        at = SurveyTime(example.START + k * 1800 * example.S, 20.0)
        other = example.survey(k, 4.0 * k, 75.0, g_total=9.8 if k == 1 else math.nan)
        whole = whole.add(link_survey.survey(values, at, k, link, None) if link else other, 270.0 + 30.0 * k, 0.0)
    if links:
        whole = whole.reject(len(came), "Aslaug", "sent again", example.MADE)
    assert head(tables.survey_table(whole, example.MADE)).get("Telemetry", "") == text


def test_the_last_row_is_the_bit_as_far_below_as_the_sensor_is_or_where_it_is_set_to_be():
    table = example.table()
    assert (table.path.kind[-1], table.column("md_m").cell(len(table.records) - 1)) == ("projected", "642.500")
    assert example.table(bit_depth=660.0).path.md[-1] == 660.0
    assert example.table(well={"sensor_to_bit": 0.0}).path.kind[-1] == "survey"


def test_the_bit_is_less_well_known_than_the_last_station():
    table = example.table()
    last, bit = (float(table.column("sigma_north_m").cell(k)) for k in table.rows[-2:])
    assert 1.0 < last < bit < 1.1 * last


def test_where_no_covariance_can_be_had_the_reason_is_reported():
    assert example.table(well={"error_model": ""}).covariance_note == "no error model is configured"
    assert "no tool code 'MWD'" in example.table(well={"error_model": "MWD"}).covariance_note
    empty = tables.survey_table(SurveyList(), 1)
    assert "no survey has a reference field" in empty.covariance_note
    assert head(empty)["Declination"] == "not available"


def test_a_plan_adds_distance_and_direction():
    plan = plan_of([0.0, 300.0, 900.0], [0.0, 0.0, 1.0], [0.0, 1.3, 1.3], name="Plan 1")
    table = example.table(plan=plan)
    assert float(table.column("to_plan_m").cell(1)) == pytest.approx(0.0, abs=1e-3)
    assert head(table)["Plan"] == "Plan 1"


@pytest.mark.parametrize(
    ("value", "decimals", "wrap", "text"),
    [
        (-0.0001, 2, 0.0, "0.00"),
        (359.999, 2, 360.0, "0.00"),
        (359.99, 2, 360.0, "359.99"),
        (None, 2, 0.0, ""),
        (math.nan, 2, 0.0, ""),
        (math.inf, 2, 0.0, ""),
        (1234.5678, 3, 0.0, "1234.568"),
    ],
)
def test_numbers_are_printed_without_minus_zero_or_360(value, decimals, wrap, text):
    assert tables.fixed(value, decimals, wrap) == text


@given(st.floats(-1e6, 1e6), st.integers(0, 6))
def test_a_printed_number_is_within_half_its_last_digit(value, decimals):
    assert abs(float(tables.fixed(value, decimals)) - value) <= 0.5 * 10.0**-decimals * (1 + 1e-9) + 1e-9


@pytest.mark.fault_case(92)
def test_time_is_utc_to_the_millisecond_and_empty_when_never(monkeypatch):
    monkeypatch.setenv("TZ", "America/New_York")
    assert tables.utc(1_778_767_020_123_456_789) == "2026-05-14T13:57:00.123Z"
    assert tables.utc(0) == ""


def test_text_is_brought_to_one_printable_line():
    assert tables.plain("a\n\tb\x00c\u2028d  Å") == "a b c d Å"


def test_an_unknown_column_is_a_key_error():
    with pytest.raises(KeyError):
        example.table().column("nonsense")


@pytest.mark.parametrize(("convergence", "text"), [(None, "no grid given"), (0.0, "0.000 deg")])
def test_a_convergence_of_zero_is_that_of_a_central_meridian_and_none_is_that_of_no_grid(convergence, text):
    well = dataclasses.replace(example.WELL, north_reference="true")
    whole = SurveyList(well=well).add(example.survey(1, 10.0, 40.0, convergence=convergence), 300.0, 0.0)
    assert head(tables.survey_table(whole, example.MADE))["Grid convergence"] == text


def test_a_place_that_is_not_given_is_called_so_and_a_grid_is_told():
    nowhere = head(example.table(well={"latitude_deg": None, "longitude_deg": None, "grid": "utm"}))
    assert nowhere["Latitude, longitude (WGS84)"] == "not given"
    assert "needs the latitude and longitude" in nowhere["Map grid"]
    placed = head(example.table(well={"grid": "EPSG:32631"}))
    assert placed["Map grid"].startswith("EPSG:32631: wellhead at 48901")
    assert "EPSG:1" in head(example.table(well={"grid": "EPSG:1"}))["Map grid"]
    assert "Map grid" not in head(example.table())
