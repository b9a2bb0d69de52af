"""What a report says: nothing taken is missing, nothing unusual goes without a word."""

import example_surveys as example
import pytest

from mwd_surface.exports.report_content import content
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.surveys.slide_sheet import Stretch


def test_the_definitive_table_ends_at_the_bit_and_says_so():
    reported = content(example.table())
    assert reported.definitive.rows[-1][0] == "projected"
    assert reported.definitive.marks[-1] == "projected"
    assert "The last station is projected to the bit; it was not surveyed." in reported.notes


def test_the_quality_page_has_every_survey_used_or_not():
    quality = content(example.table()).quality
    assert [row[0] for row in quality.rows] == [str(k) for k in range(1, 13)]
    assert quality.marks[5] == "not used"
    assert quality.marks[8] == "by hand"
    assert all(len(row) == len(quality.titles) == len(quality.units) for row in quality.rows)


def test_only_what_needs_a_word_is_among_the_decisions():
    reported = content(example.table())
    assert [row[0] for row in reported.decisions.rows] == ["3", "6", "9"]
    judged = reported.decisions.rows[-1]
    assert judged[1] == "doubtful: total field 480 nT off, limit 300"
    assert judged[2].startswith("accepted by Aslaug, 2026-05-15T")
    assert "Used on a person's word against the automatic verdict: survey 9." in reported.notes


def test_the_certificate_names_method_and_north():
    assert "minimum curvature" in content(example.table()).certificate
    assert "grid north" in content(example.table()).certificate


def test_without_a_slide_there_is_no_slide_sheet():
    assert content(example.table()).slides == ()
    rotated = tuple(s for s in example.stretches() if s.mode == "rotate")
    assert content(example.table(stretches=rotated)).slides == ()


def test_the_slide_sheet_has_every_stretch_with_toolface_steadiness_and_speed():
    sheet, _ = content(example.table(stretches=example.stretches())).slides
    assert sheet.heading == "Slide sheet: slid 54.0 m, rotated 306.0 m, 15 % slid"
    assert len(sheet.rows) == len(example.stretches())
    assert all(len(row) == len(sheet.titles) == len(sheet.units) for row in sheet.rows)
    assert sheet.rows[0][:8] == ("300.00", "330.00", "30.00", "rotate", "", "", "", "119")
    # Rounded up it is straight up again, not 360; and its reference is printed.
    assert sheet.rows[1][:8] == ("330.00", "339.00", "9.00", "slide", "0", "north", "93", "")
    assert sheet.rows[-2][4:6] == ("8", "high side")
    assert sheet.rows[1][8:] == ("2026-05-14 14:27:00", "2026-05-14 14:42:00")


def test_a_slide_of_which_no_toolface_was_known_says_nothing_of_it():
    sheet, *_ = content(example.table(stretches=(Stretch("slide", 300.0, 309.0, 1, 2),))).slides
    assert sheet.rows[0][4:8] == ("", "", "", "")


def test_what_the_slides_gave_is_the_dogleg_of_the_definitive_survey():
    table = example.table(stretches=example.stretches())
    _, gave = content(table).slides
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
    sheet, *_ = content(survey_table(whole, example.MADE, stretches=example.stretches())).slides
    assert sheet.heading.endswith("; legs are not separated")
