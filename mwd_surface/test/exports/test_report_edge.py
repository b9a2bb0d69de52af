# SPDX-License-Identifier: Apache-2.0
"""The report in another language and in field units: the same numbers, converted from their values before rounding."""

import dataclasses
import io
import math
import re

import example_surveys as example
import pypdf
import pytest

import bombs
from mwd_sensors.core import earth
from mwd_sensors.core.angle_convention import AngleConvention
from mwd_surface.exports.report_content import content
from mwd_surface.exports.report_edge import for_people
from mwd_surface.exports.report_html import report_html
from mwd_surface.exports.report_pdf import report_pdf
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.language.language import Language, language
from mwd_surface.plots import drawing as fonts
from mwd_surface.surveys.leg import Origin

ENGLISH, CHINESE = language("en"), language("zh_CN")


def of_well(**changes):
    table = example.table(stretches=example.stretches())
    well = dataclasses.replace(table.surveys.well, **changes)
    surveys = dataclasses.replace(table.surveys, well=well)
    return survey_table(surveys, table.made_ns, stretches=example.stretches())


@pytest.fixture(scope="module")
def report():
    return content(of_well())


def columns(report, unit):
    for sheet in report.sheets:
        for k, name in enumerate(sheet.units):
            if name == unit:
                yield sheet.heading, sheet.titles[k], [row[k] for row in sheet.rows]


def test_lengths_are_converted_from_their_values_and_not_from_their_print(report):
    """A converted print would be off by up to 1.6 hundredths of a foot."""
    field = for_people(report, ENGLISH, "field")
    assert not list(columns(field, "m"))
    assert not list(columns(field, "deg/30 m"))
    pairs = list(zip(columns(report, "m"), columns(field, "ft"), strict=True))
    assert len(pairs) > 10
    for (_, _, metres), (heading, title, feet) in pairs:
        for m, ft in zip(metres, feet, strict=True):
            if m and m != "end":
                assert ft == f"{m.number / 0.3048:.{m.decimals}f}".replace("-0.00", "0.00"), (heading, title)


def test_doglegs_are_per_hundred_feet(report):
    metric, field = columns(report, "deg/30 m"), columns(for_people(report, ENGLISH, "field"), "deg/100 ft")
    for (_, _, old), (_, _, new) in zip(metric, field, strict=True):
        for a, b in zip(old, new, strict=True):
            assert not a or math.isclose(float(b), a.number * 30.48 / 30.0, abs_tol=0.006)


def test_no_metre_is_left_in_a_report_in_field_units_but_those_of_the_map_grid():
    field = for_people(content(of_well(grid="utm")), ENGLISH, "field")
    left = [t for t in field.words() if re.search(r"\d m(?![\w/])", t)]
    assert all("wellhead at" in t for t in left), left
    assert any(unit == "m (grid)" for sheet in field.sheets for unit in sheet.units)


def test_a_report_in_a_language_has_the_same_numbers(report):
    numbers = re.compile(r"\d+(?:\.\d+)?")
    for old, new in zip(report.sheets, for_people(report, CHINESE, "metric").sheets, strict=True):
        for a, b in zip(old.rows, new.rows, strict=True):
            assert [sorted(numbers.findall(x)) for x in a] == [sorted(numbers.findall(x)) for x in b]


# Texts of the catalogue, and a length, that people may have typed.
TYPED = ("no data at all", "north", "stop: the tool turns", "seen at 12 m", "tool and rig")


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        *((typed, CHINESE) for typed in TYPED),
        ("seen at 12 m", ENGLISH),
        *(pytest.param(typed, ENGLISH, marks=pytest.mark.nightly) for typed in TYPED if typed != "seen at 12 m"),
    ],
)
def test_what_people_typed_is_neither_translated_nor_converted(typed, said):
    """Names of the head, people, and their reasons, in a report in another language and in feet."""
    surveys = example.table().surveys
    surveys = surveys.reject(2, typed, f"{typed} seen", 10**18)
    names = dict.fromkeys(("name", "company", "field", "rig", "service_company", "job_number", "revision"), typed)
    surveys = dataclasses.replace(surveys, well=dataclasses.replace(surveys.well, **names))
    report = for_people(content(survey_table(surveys, 10**18)), said, "field")
    assert sum(value == typed for _, value in report.header) == len(names)
    cells = [cell for sheet in report.sheets for row in sheet.rows for cell in row]
    assert cells.count(f"{typed} seen") == 1  # the reason
    assert cells.count(typed) == 1  # the person
    assert typed in report.title


def test_the_words_of_the_program_among_names_are_translated():
    """The first leg, tools in the words of WITSML, and the source of the tie-on are no names that people gave."""
    table = example.table()
    words = {"gyro north seeking": "陀螺寻北", "north": "north"}
    for tool, said in words.items():
        records = [dataclasses.replace(record, tool=tool) for record in table.surveys.records]
        surveys = dataclasses.replace(table.surveys, records=tuple(records))
        header = for_people(content(survey_table(surveys, 10**18)), CHINESE, "metric").header
        assert said in [value for _, value in header]
    assert CHINESE.entries["main"] in [value for _, value in header]
    for origin in Origin:
        for angle in AngleConvention:
            assert not CHINESE.unknown(f"{origin}, 300.00 m MD, {angle.heading} 1.00 deg, Azi 20.00 deg")


def test_numbers_have_the_decimal_mark_of_the_language(report):
    german = for_people(report, Language("de", {"Survey": "Messung"}, ","), "metric")
    assert german.sheets[0].rows[1][1] == "300,00"


def test_no_english_is_left_in_a_chinese_report(report):
    """Names, units and texts that a person typed may stay English."""
    theirs = {word for text in report.words() if CHINESE.unknown(text) and len(text) < 60 for word in text.split()}
    allowed = "RKB UTC WGS84 ISCWSA MWD nT mg m s deg mwd Rev IGRF WMM EPSG OWSG SRGM CSV ISO min rms"
    for heading in ("heading", "titles"):
        for sheet in for_people(report, CHINESE, "metric").sheets:
            texts = [sheet.heading] if heading == "heading" else sheet.titles
            for text in texts:
                words = set(re.findall(r"[A-Za-z]{3,}", text)) - set(allowed.split())
                assert not words - theirs, text


@pytest.mark.slow
def test_the_chinese_pdf_has_its_characters_its_language_and_its_data():
    made = report_pdf(of_well(language="zh_CN", units="field", job_number="J-7", revision="B", company="油田"))
    read = pypdf.PdfReader(io.BytesIO(made))
    text = "".join(page.extract_text() for page in read.pages).replace("\0", "").replace("\n", "")
    for word in ("测斜报告", "井斜角", "定案测斜数据", "作业编号", "J-7", "°/100 ft", "油田"):
        assert word in text, word
    assert read.metadata.subject.endswith("J-7")
    assert read.metadata.author == "Open MWD"
    assert len(made) < 1_000_000, "only the characters that are used get into the file"


def test_a_pdf_without_a_font_for_its_language_says_so(monkeypatch):
    monkeypatch.setattr(fonts, "wide_fonts", lambda: ())
    with pytest.raises(ValueError, match="install a font"):
        report_pdf(of_well(language="zh_CN"))


def test_the_page_is_marked_with_its_language_and_has_the_logo(tmp_path):
    logo = tmp_path / "logo.png"
    logo.write_bytes(b"\x89PNG\r\n")
    html = report_html(of_well(language="zh_CN", logo=str(logo)))
    assert '<html lang="zh-CN">' in html
    assert "data:image/png;base64," in html
    logo.write_text("not a picture")
    assert "neither PNG nor JPEG" in " ".join(content(of_well(logo=str(logo))).notes)


@pytest.mark.parametrize("kind", ["pipe", pytest.param("device", marks=pytest.mark.nightly), "endless"])
def test_a_logo_that_never_ends_is_left_out_with_a_note(kind, tmp_path):
    logo = tmp_path / "logo.png"
    {**bombs.PLACES, **bombs.FILES}[kind](logo)
    table = of_well(logo=str(logo))
    assert "data:image" not in report_html(table)
    assert "is not printed" in " ".join(content(table).notes)


@pytest.mark.slow
@pytest.mark.parametrize("convention", ["inclination", "dip_up"])
def test_every_signature_has_room_on_the_page(convention):
    """Three people sign the report of a well, four that of a mine's hole."""
    table = of_well(convention=convention)
    page = pypdf.PdfReader(io.BytesIO(report_pdf(table))).pages[0]
    places = {}
    page.extract_text(visitor_text=lambda text, _cm, tm, _font, _size: places.setdefault(text.strip(), tm[4]))
    who = content(table).signatures
    at = [next(x for text, x in places.items() if text.startswith(f"{one}, ")) for one in who]
    assert len(at) == len(who) == (4 if convention == "dip_up" else 3)
    assert max(at) < float(page.mediabox.width) - 120.0


@pytest.mark.parametrize("north", ["grid", "true"])
def test_the_place_of_a_station_on_the_map_is_that_of_its_latitude_and_longitude(north):
    """An inverse pair: the printed latitude and longitude give the printed easting and northing again."""
    report = content(of_well(north_reference=north, grid="utm"))
    sheet = next(sheet for sheet in report.sheets if sheet.heading == "Place of every station on the map")
    for row in sheet.rows:
        at = earth.map_grid(math.radians(row[2].number), math.radians(row[3].number))
        assert math.isclose(at.easting, row[4].number, abs_tol=0.01)
        assert math.isclose(at.northing, row[5].number, abs_tol=0.01)


def test_the_survey_programme_is_printed():
    sheet = next(sheet for sheet in content(of_well()).sheets if sheet.heading == "Survey programme")
    assert sheet.rows[0][2] == of_well().surveys.well.error_model
