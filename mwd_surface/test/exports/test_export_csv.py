# SPDX-License-Identifier: Apache-2.0
"""Surveys as CSV: columns, judgements, unknowns, and no cell that a spreadsheet would compute."""

import csv
import io
import math

import example_surveys as example
import pytest
import wellpathpy
from csv_rows import rows_of
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.survey.survey import Survey
from mwd_surface.exports.csv_tables import definitive_csv, raw_csv
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.signals.cells import quoted
from mwd_surface.surveys.survey_list import SurveyList


def test_the_definitive_survey_recomputes_from_its_own_columns():
    """By wellpathpy, an independent implementation."""
    rows = rows_of(definitive_csv(example.table()))
    md, inc, azi, tvd, north, east, dls = (
        [float(r[k]) for r in rows]
        for k in ("md_m", "inclination_deg", "azimuth_deg", "tvd_m", "north_m", "east_m", "dls_deg_per_30m")
    )
    peer = wellpathpy.deviation(md, inc, azi).minimum_curvature()
    assert peer.depth == pytest.approx(tvd, abs=2e-3)
    assert peer.northing == pytest.approx(north, abs=2e-3)
    assert peer.easting == pytest.approx(east, abs=2e-3)
    assert peer.dls == pytest.approx(dls, abs=1e-3)


def test_the_definitive_survey_marks_tie_on_bit_and_hand():
    text = definitive_csv(example.table())
    assert text.startswith("# Well: Åsgard Ω-1\n")
    rows = rows_of(text)
    assert [rows[0]["station"], rows[-1]["station"]] == ["tie-on", "projected"]
    by_hand = next(r for r in rows if r["sequence"] == "9")
    assert (by_hand["verdict"], by_hand["person"], by_hand["operator"]) == ("doubtful", "accepted", "Aslaug")
    assert "6" not in [r["sequence"] for r in rows]


def test_the_raw_log_has_every_survey_with_six_axes_and_both_judgements():
    rows = rows_of(raw_csv(example.surveys()))
    assert [r["sequence"] for r in rows] == [str(k) for k in range(1, 13)]
    row = rows[5]
    assert (row["in_use"], row["verdict"], row["person"]) == ("no", "reject", "")
    assert row["reasons"] == "dip 78.5 deg is 6.4 over 72.1 +- 0.45"
    assert row["time_utc"] == "2026-05-14T16:57:00.123Z"
    assert (row["magnetic_field_x_nt"], row["specific_force_y_mps2"]) == ("31000.0", "0.250000")
    assert (row["azimuth_gyro_deg"], row["azimuth_corrected_deg"]) == ("", "75.4000")
    assert row["azimuth_reference"] == "magnetic"


def test_what_is_not_known_is_an_empty_cell_and_never_zero():
    bare = Survey(10**18, "u", 1, 0.5, math.nan, 0, g_total=9.8)
    (row,) = rows_of(raw_csv(SurveyList().add(bare)))
    empty = (
        "md_m depth_age_s magnetic_field_x_nt temperature_degc b_total_nt dip_deg g_reference_mps2 b_reference_nt"
        " declination_deg azimuth_deg magnetic_toolface_deg sigma_azimuth_deg axial_interference_nt judged_utc"
    )
    assert all(row[k] == "" for k in empty.split())


@pytest.mark.fault_case(82)
@pytest.mark.parametrize("text", ["=1+1", "+A1", "-2", "@SUM(A1)", "\t=1", "\r\n=1", " =1"])
def test_no_text_starts_like_a_formula(text):
    assert quoted(text).startswith("\"'")


@pytest.mark.slow
@given(st.text(max_size=60))
def test_any_remark_stays_one_cell_of_one_line(text):
    whole = example.commented(example.surveys(), 1, text)
    rows = list(csv.DictReader(io.StringIO(raw_csv(whole))))
    assert len(rows) == 12
    assert rows[0]["comment"][:1] not in tuple("=+-@")
    assert rows[0]["uuid"] == example.survey(1, 0, 0).uuid


def test_a_hostile_head_block_stays_in_its_lines():
    table = example.table(well={"name": "a\n1,2,3\n=cmd()", "field": "x" * 300})
    text = definitive_csv(table)
    assert text.startswith("# Well: a 1,2,3 =cmd()\n")
    assert len(rows_of(text)) == len(table.records)


@pytest.mark.fault_case(92)
def test_the_decimal_sign_is_a_point_in_every_locale():
    import locale

    before = locale.setlocale(locale.LC_ALL)
    for name in ("de_DE.UTF-8", "de_DE.utf8", "nb_NO.UTF-8"):
        try:
            locale.setlocale(locale.LC_ALL, name)
        except locale.Error:
            continue
        break
    try:
        assert "642.500," in definitive_csv(example.table())
    finally:
        locale.setlocale(locale.LC_ALL, before)


def test_surveys_without_a_depth_are_named_with_what_to_do():
    surveys = example.surveys()
    number = surveys.records[-1].survey.sequence + 1
    surveys = surveys.add(example.survey(number, 15.0, 80.0))
    (why,) = survey_table(surveys, 0).left_out
    assert why.startswith(f"survey without measured depth not exported: {number};")
    assert f"# {why}" in definitive_csv(survey_table(surveys, 0))
    assert survey_table(surveys.reject(number, "Ann", "no depth", 1), 0).left_out == ()
