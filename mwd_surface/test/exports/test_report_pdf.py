# SPDX-License-Identifier: Apache-2.0
"""The PDF report read back: every printed cell, and its pages counted."""

import dataclasses
import functools
import io

import example_surveys as example
import pypdf
import pytest
from matplotlib.figure import Figure

from mwd_surface.exports.report_content import content
from mwd_surface.exports.report_pdf import report_pdf
from mwd_surface.exports.report_section import Drawing, Section
from mwd_surface.exports.survey_table import survey_table

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def table():
    return example.table(stretches=example.stretches())


@pytest.fixture(scope="module")
def pages(table):
    return [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(report_pdf(table))).pages]


def test_every_number_of_every_table_is_in_the_pdf(pages, table):
    words = " ".join(pages).split()
    reported = content(table)
    for sheet in reported.sheets:
        for row in sheet.rows:
            for k, cell in enumerate(row):
                if k not in sheet.words:
                    assert not cell or cell in words, (sheet.heading, cell)


def test_rows_are_printed_whole(pages, table):
    text = " ".join(" ".join(pages).split())
    for row in content(table).sheets[0].rows:
        assert " ".join(c for c in row[:-1] if c) in text


def test_head_certificate_and_page_numbers_are_printed(pages):
    text = " ".join(" ".join(pages).split())
    assert "Åsgard Ω-1" in text
    assert "=Société & <Fils>" in text
    assert "Slide sheet: slid 54.0 m, rotated 306.0 m" in text
    assert "Certified that this survey" in text
    for k in range(1, len(pages) + 1):
        assert f"page {k} of {len(pages)}" in text


@functools.cache
def report_of(stations, language="en"):
    """Report of a list of a number of stations."""
    surveys = example.surveys(dataclasses.replace(example.WELL, language=language))
    surveys = surveys.with_records(surveys.records[:stations])
    for k in range(13, stations + 1):
        surveys = surveys.add(example.survey(k, 40.0, 79.8), 270.0 + 30.0 * k, 0.1)
    return pypdf.PdfReader(io.BytesIO(report_pdf(survey_table(surveys, example.MADE))))


def test_a_long_list_flows_over_pages_and_repeats_its_titles():
    reader = report_of(60)
    texts = [page.extract_text() for page in reader.pages]
    assert sum("Inc" in t and "TVD" in t for t in texts) >= 3
    assert reader.metadata.title == "Survey report Åsgard Ω-1, Ω-1 ST0"


def tall_section(height_to_width, wide):
    """Two drawings of a given ratio of height to width under a heading that names it."""

    def draw():
        return Figure(figsize=(4.0, 4.0 * height_to_width))

    captions = (f"one of {height_to_width}", f"two of {height_to_width}")
    return Section(f"Heading of {height_to_width}", drawings=tuple(Drawing(one, draw, wide=wide) for one in captions))


@pytest.mark.parametrize("wide", [True, False])
def test_drawings_lie_whole_on_the_page_of_their_heading(wide):
    heights_to_widths, headed = (0.2, 0.7, 1.0, 3.0), []
    surveys = example.surveys()
    short = survey_table(surveys.with_records(surveys.records[:4]), example.MADE)
    sections = (*short.sections, *(tall_section(ratio, wide) for ratio in heights_to_widths))
    for page in pypdf.PdfReader(io.BytesIO(report_pdf(dataclasses.replace(short, sections=sections)))).pages:
        seen = []

        def image(operator, operands, current, _text, page=page, seen=seen):
            if operator == b"Do":
                width, _, _, height, x, y = current
                assert y >= 0.0
                assert x + width <= float(page.mediabox.width)
                seen.append(height / width)

        text = page.extract_text(visitor_operand_before=image)
        here = [ratio for ratio in heights_to_widths if f"Heading of {ratio}" in text]
        assert here == [ratio for ratio in heights_to_widths if f"one of {ratio}" in text]
        assert all(pytest.approx(ratio, rel=0.01) in seen for ratio in here)
        headed += here
    assert headed == list(heights_to_widths)


_FOOT_MM = 12.0  # margin with the page number


def filled(page):
    """Return the share of a page, between its margins, down to its lowest text, line or drawing."""
    height, foot = float(page.mediabox.height), _FOOT_MM * 72.0 / 25.4
    lowest = [height]

    def operand(operator, operands, current, text):
        if operator == b"Do":
            lowest.append(current[5])
        elif operator in (b"l", b"m", b"re"):
            lowest.append(current[5] + float(operands[1]))

    def word(text, current, matrix, *_):
        if text.strip():
            lowest.append(current[5] + matrix[5])

    page.extract_text(visitor_operand_before=operand, visitor_text=word)
    return (height - min(y for y in lowest if y > foot)) / (height - 2.0 * foot)


# As many stations as the demonstration has in both languages, then long lists.
@pytest.mark.slow(4)
@pytest.mark.parametrize(
    ("stations", "language"),
    [
        pytest.param(4, "en", marks=pytest.mark.nightly),
        (4, "zh_CN"),
        pytest.param(12, "en", marks=pytest.mark.nightly),
        pytest.param(42, "zh_CN", marks=pytest.mark.nightly),
        (60, "en"),
    ],
)
def test_no_page_is_nearly_empty(stations, language):
    shares = [filled(page) for page in report_of(stations, language).pages]
    # The last page ends where the report does.
    assert min(shares[:-1]) > 0.35, shares
    assert shares[-1] > 0.15, shares
