"""What a report says: nothing taken is missing, nothing unusual goes without a word."""

import example_surveys as example

from mwd_surface.exports.report_content import content


def test_the_definitive_table_ends_at_the_bit_and_says_so():
    said = content(example.table())
    assert said.definitive.rows[-1][0] == "projected"
    assert said.definitive.marks[-1] == "projected"
    assert "The last station is projected to the bit; it was not surveyed." in said.notes


def test_the_quality_page_has_every_survey_used_or_not():
    quality = content(example.table()).quality
    assert [row[0] for row in quality.rows] == [str(k) for k in range(1, 13)]
    assert quality.marks[5] == "not used"
    assert quality.marks[8] == "by hand"
    assert all(len(row) == len(quality.titles) == len(quality.units) for row in quality.rows)


def test_only_what_needs_a_word_is_among_the_decisions():
    said = content(example.table())
    assert [row[0] for row in said.decisions.rows] == ["3", "6", "9"]
    judged = said.decisions.rows[-1]
    assert judged[1] == "doubtful: total field 480 nT off, limit 300"
    assert judged[2].startswith("accepted by Aslaug, 2026-05-15T")
    assert "Used on a person's word against the automatic verdict: survey 9." in said.notes


def test_the_certificate_names_method_and_north():
    assert "minimum curvature" in content(example.table()).certificate
    assert "grid north" in content(example.table()).certificate
