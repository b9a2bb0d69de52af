# SPDX-License-Identifier: Apache-2.0
"""A survey as a line of a table: columns that other programs rely on, and empty cells for unknown values."""

import csv
import dataclasses
import io
import math

import example_surveys
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_estimation.core.reason_text import joined
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.station import station
from mwd_estimation.survey.survey import AzimuthEstimate, Verdict
from mwd_surface.exports.csv_tables import definitive_csv, raw_csv
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.list_files.six_axis_table import TableStation
from mwd_surface.signals.cells import fixed
from mwd_surface.signals.table import SURVEY_TABLE
from mwd_surface.surveys import survey_csv
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.surveys.table_run import table_surveys

F_T, B_T = np.array([-8.0, 1.0, 5.5]), np.array([3.0e-5, 1.0e-5, -3.5e-5])
REFERENCE = Reference(total=4.72e-5, dip=1.2, declination=0.03, convergence=0.01, gravity=9.8)


def test_the_promised_columns_come_first():
    assert survey_csv.COLUMNS[:10] == (
        "md_m",
        "inclination_deg",
        "azimuth_deg",
        "azimuth_reference",
        "toolface_deg",
        "g_total_mps2",
        "b_total_nt",
        "dip_deg",
        "verdict",
        "reasons",
    )


def record(one, measured_depth=math.nan):
    """Return the record of a station from a table of readings."""
    (row,) = table_surveys([TableStation(measured_depth, "", one)])
    return row.record


def test_a_line_has_the_values_of_the_station():
    one = station(F_T, B_T, REFERENCE)
    text = survey_csv.text([survey_csv.cells(record(one, 1234.5))])
    line = next(csv.DictReader(io.StringIO(text)))
    assert line["md_m"] == "1234.500"
    assert float(line["inclination_deg"]) == pytest.approx(math.degrees(one.inclination), abs=6e-5)
    assert float(line["azimuth_deg"]) == pytest.approx(math.degrees(one.azimuth), abs=6e-5)
    assert float(line["sigma_toolface_deg"]) == pytest.approx(math.degrees(one.sigma_toolface), abs=6e-5)
    assert line["azimuth_reference"] == "grid"
    assert float(line["b_total_nt"]) == pytest.approx(one.b_total * 1e9, abs=0.06)
    assert line["verdict"] == one.verdict
    assert line["reasons"] == joined(one.reasons)
    assert float(line["b_reference_nt"]) == 47200.0
    assert (line["first_azimuth_deg"], line["revised_because"]) == (line["azimuth_deg"], "")


def test_a_revised_station_has_its_first_value_and_the_reason():
    now = record(station(F_T, B_T, REFERENCE))
    first = dataclasses.replace(now.survey, azimuth=now.survey.azimuth + 0.1, verdict=int(Verdict.DOUBTFUL))
    line = survey_csv.cells(dataclasses.replace(now, first=(first,)))
    assert line["first_azimuth_deg"] == f"{math.degrees(first.azimuth):.4f}"
    assert (line["first_verdict"], line["verdict"]) == ("doubtful", Verdict(now.survey.verdict).word)
    assert line["revised_because"]


def test_unknown_values_are_empty_cells():
    line = survey_csv.cells(record(station(F_T, np.full(3, np.nan))))
    empty = ("md_m", "azimuth_deg", "azimuth_reference", "sigma_azimuth_deg", "b_total_nt", "dip_deg", "b_reference_nt")
    assert [line[name] for name in empty] == [""] * len(empty)
    assert line["verdict"] == "reject"
    assert line["inclination_deg"] != ""


def test_no_angle_is_written_as_360():
    one = record(station(F_T, B_T, REFERENCE))
    north = dataclasses.replace(one, survey=dataclasses.replace(one.survey, azimuth=math.tau - 1e-9))
    assert survey_csv.cells(north)["azimuth_deg"] == "0.0000"
    assert fixed(-1e-9, 2) == "0.00"


def test_every_column_of_numbers_has_its_unit_in_its_name_and_reads_as_a_number():
    line = survey_csv.cells(record(station(F_T, B_T, REFERENCE), 1234.5))
    assert tuple(line) == survey_csv.COLUMNS
    ends = {"deg": "deg", "m": "m", "nT": "nt", "m/s^2": "mps2", "deg/30 m": "deg_per_30m", "deg/h": "degph", "s": "s"}
    for signal, listed in SURVEY_TABLE:
        if signal.type == "Double" and signal.unit != "1":
            assert listed.key.endswith("_" + ends.get(signal.listed_scale.symbol, "degc"))
        if listed.key not in survey_csv.TEXTS and line[listed.key]:
            assert math.isfinite(float(line[listed.key]))


def test_every_table_of_surveys_has_the_same_columns_and_the_same_cells_of_a_survey():
    surveys = example_surveys.surveys()
    definitive, raw = (
        list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
        for text in (definitive_csv(survey_table(surveys, 0)), raw_csv(surveys))
    )
    assert tuple(definitive[0]) == tuple(raw[0]) == survey_csv.COLUMNS
    by_number = {row["sequence"]: row for row in raw}
    # The definitive list has azimuths from the north of the well, the raw one from each survey's own north.
    turned = {name for name in survey_csv.COLUMNS if "azimuth" in name and "sigma" not in name}
    turned |= {"magnetic_toolface_deg", "alternatives_deg"}
    used = [row for row in definitive if row["sequence"]]
    assert len(used) == sum(record.in_use for record in surveys.records)
    for row in used:
        own = by_number[row["sequence"]]
        for name in survey_csv.COLUMNS:
            assert row[name] == own[name] or name in turned, name
            assert bool(row[name]) == bool(own[name]), name


@given(st.sampled_from(list(North)), st.floats(0.0, 6.28), st.floats(-0.3, 0.3), st.floats(-0.1, 0.1))
def test_all_azimuths_of_a_line_have_the_north_that_it_names(north, azimuth, declination, convergence):
    given_ = example_surveys.survey(1, 30.0, math.degrees(azimuth))
    survey = dataclasses.replace(
        given_, azimuth=azimuth, north=int(North.MAGNETIC), declination=declination, convergence=convergence,
        azimuths=(AzimuthEstimate("gyro", 1, azimuth, 0.01, 1.0),), alternatives=(azimuth,), alternative_odds=(0.1,),
        magnetic_toolface=azimuth,
    )  # fmt: skip
    line = survey_csv.cells(SurveyRecord(survey), north)
    named = North[line["azimuth_reference"].upper()]
    assert named == (north if north != North.UNKNOWN else North.MAGNETIC)
    same = ("azimuth_deg", "azimuth_gyro_deg", "first_azimuth_deg", "magnetic_toolface_deg", "alternatives_deg")
    assert len({line[name] for name in same}) == 1
    turn = {North.MAGNETIC: 0.0, North.TRUE: declination, North.GRID: declination - convergence}[named]
    off = math.radians(float(line["azimuth_deg"])) - azimuth - turn
    assert abs(math.remainder(off, math.tau)) < 2e-6
