# SPDX-License-Identifier: Apache-2.0
"""What a report says: nothing taken is missing, nothing unusual goes without a word."""

import dataclasses
import math

import example_surveys as example
import pytest

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.exports.report_content import content
from mwd_surface.exports.report_section import Section
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.surveys.station_quality import totals
from mwd_surface.trajectory.slide_sheet import DrilledStretch


def sheet(table, beginning):
    return next(one for one in content(table).sheets if one.heading.startswith(beginning))


def cells(one, title):
    """A column of a sheet by its title; the first of that name."""
    return [row[one.titles.index(title)] for row in one.rows]


def test_the_definitive_table_ends_at_the_bit_and_says_so():
    reported = content(example.table())
    assert reported.sheets[0].rows[-1][0] == "projected"
    assert reported.sheets[0].marks[-1] == "projected"
    assert "The last station is projected to the bit; it was not surveyed." in reported.notes


def test_the_quality_page_has_every_survey_used_or_not():
    quality = sheet(example.table(), "Quality control")
    assert cells(quality, "Survey") == [str(k) for k in range(1, 13)]
    assert quality.marks[5] == "not used"
    assert quality.marks[8] == "by hand"
    assert all(len(row) == len(quality.titles) == len(quality.units) for row in quality.rows)


def test_deviations_stand_beside_the_limits_of_the_same_value():
    table = example.table()
    quality, read = sheet(table, "Quality control"), sheet(table, "Totals as read")
    for k, record in enumerate(sorted(table.surveys.records, key=lambda r: r.survey.sequence)):
        _, field, dip = totals(record.survey)
        row = dict(zip(quality.titles, quality.rows[k], strict=True))
        assert float(row["ΔB"]) == pytest.approx(field.deviation * 1e9, abs=0.51)
        # The toolface of the sixth is not determined: its field is judged as it was read.
        assert row["Judged as"] == ("as read" if k == 5 else "corrected")
        assert float(read.rows[k][read.titles.index("B judged")]) == pytest.approx(field.value * 1e9, abs=0.51)
        assert float(read.rows[k][read.titles.index("Dip read")]) == pytest.approx(math.degrees(dip.read), abs=0.0051)
        limits = [quality.rows[k][j] for j, title in enumerate(quality.titles) if title == "limit ±"]
        assert limits == ["2.50", "300", "0.45"]
        assert quality.tints[k, quality.titles.index("ΔB")] == field.light


def test_each_quantity_has_its_verdict_and_its_tint():
    quality = sheet(example.table(), "Quality control")
    rejected = quality.rows[5]
    found = {title: rejected[quality.titles.index(title)] for title in ("Inc is", "Azi is", "Toolface is")}
    assert found == {"Inc is": "accept", "Azi is": "reject", "Toolface is": "not determined"}
    assert quality.tints[5, quality.titles.index("Azi is")] == "reject"
    assert (5, quality.titles.index("Toolface is")) not in quality.tints


def test_the_run_is_summed_up_by_tool():
    table = example.table()
    found = sheet(table, "Quality of the run")
    run = dict(zip(found.titles, found.rows[0], strict=True))
    used = [r.survey for r in table.surveys.records if r.in_use]
    rms = math.sqrt(sum((totals(s)[0].deviation / STANDARD_GRAVITY * 1e3) ** 2 for s in used) / len(used))
    assert (run["Tool"], run["Taken"], run["Used"], run["By hand"]) == ("T-0042", "12", "11", "1")
    assert float(run["rms ΔG"]) == pytest.approx(rms, abs=0.0051)
    assert (run["Axial"], run["spread"]) == ("850", "0")
    assert run["Azi accepted"] == "83"
    assert run["Disturbed by"] == "steel outside the string (1)"


def test_stations_of_a_list_of_angles_do_not_stand_among_azimuths_by_method():
    whole = example.surveys()
    bare = [
        dataclasses.replace(r, survey=dataclasses.replace(r.survey, azimuths=())) if r.survey.sequence == 3 else r
        for r in whole.records
    ]
    compared = sheet(survey_table(whole.with_records(bare), 10**18), "Azimuth by method")
    assert cells(compared, "Survey") == [str(k) for k in range(1, 13) if k != 3]


def test_a_final_list_is_titled_so():
    table = example.table()
    assert content(dataclasses.replace(table, final=True)).title != content(table).title


def test_azimuths_of_all_methods_stand_beside_each_other_from_one_north():
    table = example.table()
    compared = sheet(table, "Azimuth by method, from grid north")
    assert cells(compared, "corrected") == cells(compared, "Azi")
    raw, used = (float(cells(compared, title)[3]) for title in ("raw", "Azi"))
    assert raw - used == pytest.approx(0.8, abs=0.011)
    # Given from magnetic north, printed from grid: declination less convergence further.
    assert cells(compared, "Others that fit, deg")[5] == "192.0 (25.0 %)"


def test_only_verdicts_that_want_attention_are_explained():
    attention = sheet(example.table(), "Automatic verdicts")
    assert cells(attention, "Survey") == ["6", "9"]
    assert cells(attention, "What to do") == [
        "External magnetic field: move the sensor or use a gyro",
        "total field 480 nT off, limit 300",
    ]
    assert cells(attention, "May be disturbed by")[0] == "steel outside the string 90 %, magnetised collar 10 %"
    assert cells(attention, "Details")[0] == "dip 78.5 deg is 6.4 over 72.1 +- 0.45"


def test_every_decision_is_listed_with_who_when_and_why_after_the_automatic_one():
    whole = example.surveys().reject(9, "Bo", "casing is near", example.START + 95_000 * 10**9)
    table = survey_table(whole, example.MADE)
    decided = sheet(table, "Decisions; ")
    assert cells(decided, "Survey") == ["9", "9", "9"]
    assert cells(decided, "By") == ["automatic", "Aslaug", "Bo"]
    assert cells(decided, "Decision") == ["doubtful", "accepted", "rejected"]
    assert cells(decided, "Why")[1:] == ["-casing; gyro agrees", "casing is near"]
    assert decided.marks == ("", "", "not used")
    assert cells(sheet(table, "Flags and remarks"), "Survey") == ["3"]
    assert "Used by manual decision against the automatic verdict: survey 9." in content(example.table()).notes


def test_the_ellipses_are_explained_and_further_sections_are_printed():
    path = next(one for one in content(example.table()).sections if one.heading == "Well path")
    assert "86 %" in path.text[0]
    bare = next(one for one in content(example.table(well={"error_model": ""})).sections if one.heading == "Well path")
    assert bare.text == ("No position uncertainty: no error model is configured.",)
    further = Section("Check shots", ("None were taken.",))
    assert content(example.table(sections=(further,))).sections[-1] == further


def test_the_certificate_names_method_and_north():
    assert "minimum curvature" in content(example.table()).certificate
    assert "grid north" in content(example.table()).certificate


def test_without_a_slide_there_is_no_slide_sheet():
    rotated = tuple(s for s in example.stretches() if s.mode == "rotate")
    for table in (example.table(), example.table(stretches=rotated)):
        assert not [one for one in content(table).sections if one.heading == "Slide sheet"]


def test_the_slide_sheet_has_every_stretch_with_toolface_steadiness_and_speed():
    slid = sheet(example.table(stretches=example.stretches()), "Slide sheet")
    assert slid.heading == "Slide sheet: slid 54.0 m, rotated 306.0 m, 15 % slid"
    assert len(slid.rows) == len(example.stretches())
    assert all(len(row) == len(slid.titles) == len(slid.units) for row in slid.rows)
    assert slid.rows[0][:8] == ("300.00", "330.00", "30.00", "rotate", "", "", "", "119")
    # Rounded up it is straight up again, not 360; and its reference is printed.
    assert slid.rows[1][:8] == ("330.00", "339.00", "9.00", "slide", "0", "north", "93", "")
    assert slid.rows[-2][4:6] == ("8", "high side")
    assert slid.rows[1][8:] == ("2026-05-14 14:27:00", "2026-05-14 14:42:00")


def test_a_slide_of_which_no_toolface_was_known_says_nothing_of_it():
    slid = sheet(example.table(stretches=(DrilledStretch("slide", 300.0, 309.0, 1, 2),)), "Slide sheet")
    assert slid.rows[0][4:8] == ("", "", "", "")


def test_what_the_slides_gave_is_the_dogleg_of_the_definitive_survey():
    table = example.table(stretches=example.stretches())
    gave = sheet(table, "Yield of the slides")
    depth, severity = table.column("md_m"), table.column("dls_deg_per_30m")
    found = {depth.cell(k, paper=True): severity.cell(k, paper=True) for k in table.rows}
    titles = {title: k for k, title in enumerate(gave.titles)}
    assert len(gave.rows) == 10
    assert [row[titles["DLS"]] for row in gave.rows] == [found[row[titles["To"]]] for row in gave.rows]
    slid = [row for row in gave.rows if float(row[titles["Slid"]]) > 0.0]
    one = slid[-1]
    assert float(one[titles["Motor yield"]]) == pytest.approx(
        float(one[titles["Dogleg"]]) / float(one[titles["Slid"]]) * 30.0, abs=0.02
    )
    assert all(row[titles["Motor yield"]] == "" for row in gave.rows if row[titles["Slid"]] == "0.0")


def test_a_well_of_several_legs_says_that_its_slides_are_not_distinguished():
    whole = example.surveys().sidetracked("ST 1", 400.0)
    slid = sheet(survey_table(whole, example.MADE, stretches=example.stretches()), "Slide sheet")
    assert slid.heading.endswith("; legs are not separated")
