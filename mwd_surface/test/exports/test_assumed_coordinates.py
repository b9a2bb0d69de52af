# SPDX-License-Identifier: Apache-2.0
"""Coordinates that rest on an assumption look so in every export, on the page and to the rig; given ones do not."""

import dataclasses
import functools
import io
import math
import re

import example_surveys as example
import ezdxf
import lasio
import openpyxl
import pytest
from csv_rows import rows_of
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from mwd_surface.exports.csv_tables import definitive_csv, path_csv
from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.export_witsml import NAMESPACE
from mwd_surface.exports.report_plots import plan_view, section_view
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.list_files.list_file import list_of
from mwd_surface.list_files.remark import RemarkKind, distinct
from mwd_surface.page.state_json import path_table, survey_row
from mwd_surface.rig.survey import accepted_surveys
from mwd_surface.rig.values import Condition, nothing_yet, survey_values
from mwd_surface.rig.wits.records import RecordWriter, Wits0Format
from mwd_surface.signals.table import LISTED
from mwd_surface.surveys.imported_list import survey_list
from mwd_surface.surveys.leg import Leg, Origin, TieOn
from mwd_surface.surveys.survey_list import OF_START, SurveyList
from mwd_surface.trajectory.advice import AdviceBasis, AdviceMode, AdvisorySettings, advise
from mwd_surface.trajectory.plan import plan_of, straight
from mwd_surface.trajectory.well_path import ASSUMED, TIE_ON

GIVEN = TieOn.given(270.0, 0.0, 1.3, (2.0, 3.0, 269.5))
UNTIED = TieOn()
WITHOUT_POSITION = TieOn.given(270.0, 0.02, 1.3)
NS = {"w": NAMESPACE}
POSITIONS = {"survey_vertical_depth", "survey_north", "survey_east", "survey_vertical_section"}


def csv_flag(data):
    cells = {row["coordinates"] for row in rows_of(data)}
    head = b"\n# Coordinates: assumed" in data
    assert cells == ({"assumed"} if head else {""})
    return head


def las_flag(data):
    file = lasio.read(io.StringIO(data.decode()))
    values = set(file["ASMD"])
    assert len(values) == 1
    assert any(item.descr == "ASSUMED" for item in file.params) == bool(values == {1.0})
    return values == {1.0}


def witsml_flag(data):
    root = etree.fromstring(data)
    states = {one.text for one in root.iterfind(".//w:statusTrajStation", NS)}
    notes = [one.findtext("w:commonData/w:comments", "", NS) for one in root.iterfind(".//w:trajectoryStation", NS)]
    flagged = root.findtext("w:trajectory/w:definitive", "", NS) == "false"
    assert states == ({"open"} if flagged else {"position"})
    assert {"assumed" in note for note in notes} == {flagged}
    return flagged


def report_flag(data):
    text = data.decode()
    assert ("not certified" in text) == ("<dt>Coordinates</dt><dd>assumed" in text)
    return "not certified" in text


def dxf_flag(data):
    drawing = ezdxf.read(io.StringIO(data.decode()))
    titles = [text.dxf.text for text in drawing.modelspace().query("TEXT") if "1 unit" in text.dxf.text]
    return all("(coordinates assumed)" in title for title in titles)


def xlsx_flag(data):
    head = openpyxl.load_workbook(io.BytesIO(data)).worksheets[0]
    return any(row[0].value == "Coordinates" for row in head.iter_rows())


FLAGS = {
    "csv": csv_flag,
    "las": las_flag,
    "witsml": witsml_flag,
    "html": report_flag,
    "dxf": dxf_flag,
    "xlsx": xlsx_flag,
}


def rows_flag(data):
    """Flag of a table without a head."""
    cells = {row["coordinates"] for row in rows_of(data)}
    assert cells in ({"assumed"}, {""})
    return cells == {"assumed"}


@functools.cache
def exported(kind, tie_on):
    table = example.table(tie_on=tie_on)
    if kind == "path":
        return path_csv(table).encode()
    if kind == "deviation":
        plan = straight(1.0, 1.0, 900.0, table.surveys.well.north_reference)
        table = survey_table(table.surveys.along(plan), example.MADE)
    return FORMATS[kind].make(table)


@pytest.mark.parametrize("tie_on", [UNTIED, WITHOUT_POSITION])
@pytest.mark.parametrize("kind", [*FLAGS, "deviation", "path"])
def test_an_export_flags_a_list_with_an_assumed_tie_on_and_not_the_same_list_with_a_given_one(kind, tie_on):
    flag = FLAGS.get(kind, rows_flag)
    assert flag(exported(kind, tie_on))
    assert not flag(exported(kind, GIVEN))


def test_every_format_with_positions_has_its_flag_checked():
    # The raw log has no positions, the PDF has the content of the HTML report, and a deviation needs a plan.
    assert set(FORMATS) - set(FLAGS) == {"raw_csv", "pdf", "deviation"}


def test_path_csv_has_the_numbers_of_the_definitive_survey_under_the_same_names_with_more_digits():
    table = example.table()
    exact, printed = rows_of(path_csv(table)), rows_of(definitive_csv(table))
    for signal, listed in LISTED:
        for one, other in zip(exact, printed, strict=True):
            assert (one[listed.key] == "") == (other[listed.key] == ""), signal.name
            if one[listed.key]:
                assert abs(float(one[listed.key]) - float(other[listed.key])) <= 0.5001 * 10.0**-listed.decimals


def test_the_hole_above_an_untied_survey_is_drawn_in_a_line_of_its_own():
    for draw in (plan_view, section_view):
        named = draw(example.table(tie_on=UNTIED)).axes[0].get_legend_handles_labels()[1]
        assert "hole assumed, not surveyed" in named
        assert "survey, place assumed" in named
        given = draw(example.table(tie_on=GIVEN)).axes[0].get_legend_handles_labels()[1]
        assert "survey" in given
        assert not any("assumed" in word for word in given)


def test_the_page_marks_path_and_rows():
    for tie_on, first, flagged in ((UNTIED, ASSUMED, True), (WITHOUT_POSITION, TIE_ON, True), (GIVEN, TIE_ON, False)):
        whole = example.surveys(tie_on=tie_on)
        table = path_table(whole.definitive(), 0.0, None, 100)
        assert table["kind"][0] == first
        assert bool(table["assumptions"]) == flagged
        rows = [survey_row(record, whole.north) for record in whole.records]
        assert {row["assumed"] for row in rows if row["in_use"]} == {flagged}
        assert not any(row["assumed"] for row in rows if not row["in_use"])


def test_positions_to_the_rig_are_uncertain_and_angles_are_not():
    whole = example.surveys(tie_on=UNTIED)
    values = survey_values(accepted_surveys(whole)[-1], example.MADE)
    doubtful = {name for name, value in values.items() if value.condition == Condition.DOUBTFUL}
    assert doubtful == POSITIONS
    assert all(value.reason.startswith("assumed: ") for name, value in values.items() if name in POSITIONS)
    # The curvature of the first interval is that of the assumed hole.
    first = survey_values(accepted_surveys(whole)[0], example.MADE)
    assert first["survey_dogleg"].condition == Condition.DOUBTFUL
    good = survey_values(accepted_surveys(example.surveys(tie_on=GIVEN))[-1], example.MADE)
    assert {good[name].condition for name in POSITIONS} == {Condition.GOOD}


def test_wits_which_has_no_quality_leaves_out_an_assumed_position():
    def items(tie_on):
        survey = accepted_surveys(example.surveys(tie_on=tie_on))[-1]
        return {code for code, _ in RecordWriter(Wits0Format()).survey(nothing_yet(), survey)}

    assert items(GIVEN) - items(UNTIED) == {709, 718, 719}
    assert {708, 713, 715} <= items(UNTIED)


def test_the_uncertainty_of_an_assumed_start_is_withheld_with_its_reason():
    table = example.table(tie_on=UNTIED)
    assert table.covariance is None
    assert "no tie-on is given" in table.covariance_note
    assert example.table(tie_on=GIVEN).covariance is not None


def test_no_advice_leads_from_a_position_that_is_assumed_to_the_plan():
    plan = plan_of([0.0, 600.0, 1800.0], [0.0, 0.3, 1.0], [1.3, 1.3, 1.3])
    for tie_on, modes in ((UNTIED, {AdviceMode.NONE}), (GIVEN, {AdviceMode.SLIDE, AdviceMode.ROTATE})):
        advice = advise(AdvisorySettings(), plan, example.surveys(tie_on=tie_on).definitive(), (), AdviceBasis())
        assert advice.mode in modes
        assert ("assumed" in advice.reason) == (tie_on is UNTIED)


@given(
    st.floats(1.0, 4000.0), st.floats(0.0, 80.0), st.floats(0.0, 359.0), st.sampled_from(["none", "given", "position"])
)
def test_a_path_is_assumed_exactly_where_nobody_gave_its_start_and_the_first_station_is_not_near_it(
    depth, inclination_deg, azimuth_deg, origin
):
    tie_on = {
        "none": TieOn(),
        "given": TieOn.given(0.5 * depth, 0.0, 0.0, (1.0, 2.0, 0.5 * depth)),
        "position": TieOn.given(0.5 * depth, 0.0, 0.0),
    }[origin]
    whole = SurveyList(well=example.WELL, legs=(Leg(tie_on=tie_on),))
    whole = whole.add(example.survey(1, inclination_deg, azimuth_deg), depth, 0.4)
    path = whole.definitive()
    near = depth <= whole.rules.gap_limit and inclination_deg * 30.0 <= whole.rules.dogleg_limit_deg * depth
    assert path.assumed == {"none": not near, "given": False, "position": True}[origin]
    assert (path.kind[0] == ASSUMED) == (origin == "none" and not near)


def test_a_bit_far_below_the_wellhead_without_a_survey_is_assumed_too():
    assert SurveyList().definitive(bit_depth=2000.0).assumed
    assert not SurveyList().definitive(bit_depth=20.0).assumed


def test_a_sidetrack_is_assumed_as_its_parent_is_and_follows_when_the_parent_gets_its_tie_on():
    def sidetracked(tie_on):
        whole = example.surveys(tie_on=tie_on).sidetracked("st1", 450.0)
        return whole.add(example.survey(20, 20.0, 75.0), 480.0, 0.4)

    assert sidetracked(UNTIED).definitive("st1").assumed
    tied = sidetracked(UNTIED).tied_on(GIVEN, "main")
    assert not tied.definitive("st1").assumed
    moved = tied.definitive("main").at(450.0)[2]
    kick_off = tied.find_leg("st1").tie_on
    assert (kick_off.north, kick_off.east, kick_off.vertical_depth) == pytest.approx(tuple(moved))
    assert kick_off.source == Origin.LEG
    given_at_once = sidetracked(GIVEN).definitive()
    assert tied.definitive("st1").positions[-1] == pytest.approx(given_at_once.positions[-1])


def test_an_assumed_north_is_said_beside_the_azimuths():
    text = b"md_m,inc,azi\n0,0,0\n30,1,10\n60,2,12\n"
    surveys = survey_list(list_of(text))
    assert {one.kind for one in surveys.definitive().assumptions} == {RemarkKind.NORTH_ASSUMED}
    header = dict(survey_table(surveys, example.MADE).header)
    assert header["Azimuth reference"].endswith("north, assumed")
    named = survey_list(list_of(text.replace(b"azi", b"azi_true")))
    assert not named.definitive().assumed


def rows(columns, *stations):
    return "\n".join([columns, *(",".join(map(str, one)) for one in stations)]).encode() + b"\n"


BELOW = ((600, 8.0, 30.0), (630, 9.0, 31.0), (660, 10.0, 31.0))
# A list as a file, what its coordinates rest on, and what else is said of where its path starts.
FROM_DEPTH, NORTH = RemarkKind.HOLE_ABOVE_ASSUMED, RemarkKind.NORTH_ASSUMED
LISTS = {
    "begins at depth": ("md_m,inc_deg,azi_true", BELOW, {FROM_DEPTH}, set()),
    "begins at depth, too steep": ("md_m,inc_deg,azi_true", ((6, 85, 30), (36, 86, 30)), {FROM_DEPTH}, set()),
    "begins at depth with a depth no arc reaches": (
        "md_m,inc_deg,azi_true,tvd_m",
        ((600, 8.0, 30.0, 540.0), (630, 8.0, 30.0, 569.71)),
        {RemarkKind.TIE_ON_ASSUMED},
        set(),
    ),
    "begins at depth with a depth an arc reaches": (
        "md_m,inc_deg,azi_true,tvd_m",
        ((600, 8.0, 30.0, 598.05), (630, 8.0, 30.0, 627.76)),
        {FROM_DEPTH},
        set(),
    ),
    "begins at depth with a whole position": (
        "md_m,inc_deg,azi_true,tvd_m,ns_m,ew_m",
        ((600, 8, 0, 540, 150, 20), (630, 8, 0, 569.71, 154.18, 20)),
        set(),
        {RemarkKind.TIE_ON_OF_LIST},
    ),
    "has a station at the wellhead": ("md_m,inc_deg,azi_true", ((0, 0, 0), *BELOW), set(), set()),
    "begins near the wellhead": ("md_m,inc_deg,azi_true", ((20, 0.5, 10), (50, 1, 10)), set(), {FROM_DEPTH}),
    "does not name its north": ("md_m,inc_deg,azi", ((0, 0, 0), *BELOW), {NORTH}, set()),
    "begins at depth and does not name its north": ("md_m,inc_deg,azi", BELOW, {NORTH, FROM_DEPTH}, set()),
}


@pytest.mark.parametrize("case", LISTS)
def test_what_the_reader_assumed_flags_coordinates_everywhere_and_is_said_once(case):
    columns, stations, assumed, said = LISTS[case]
    surveys = survey_list(list_of(rows(columns, *stations)))
    path = surveys.definitive()
    assert {one.kind for one in path.assumptions} == assumed
    # Of the start of a path the reader's sentence is the only one.
    start = [one for one in distinct((*path.assumptions, *surveys.remarks)) if one.kind in OF_START]
    assert [one.kind for one in start] == [one for one in OF_START if one in assumed | said]
    table = survey_table(surveys, example.MADE)
    for kind, flag in FLAGS.items():
        assert flag(FORMATS[kind].make(table)) == bool(assumed), kind
    page = path_table(path, 0.0, None, 100)
    assert len(page["assumptions"]) == len(assumed)
    values = survey_values(accepted_surveys(surveys)[-1], example.MADE)
    assert {values[name].condition == Condition.DOUBTFUL for name in POSITIONS} == {bool(assumed)}
    # The same path looks the same after it went to the file of the list and back.
    assert SurveyList.from_mapping(surveys.to_mapping()).definitive().assumptions == path.assumptions


def test_an_assumption_about_the_start_ends_where_a_person_gives_the_start():
    surveys = survey_list(list_of(rows("md_m,inc_deg,azi", *BELOW)))
    tied = surveys.tied_on(GIVEN)
    assert {one.kind for one in tied.definitive().assumptions} == {RemarkKind.NORTH_ASSUMED}
    assert {one.kind for one in tied.remarks} == {RemarkKind.NORTH_ASSUMED}


# Fields of the well, and the line of the head block that prints each.
LINES = {
    "company": "Company",
    "field": "Field",
    "rig": "Rig",
    "service_company": "Survey company",
    "latitude_deg": "Latitude, longitude (WGS84)",
    "depth_datum": "Depth datum",
    "datum_elevation": "Datum elevation",
    "sensor_to_bit": "Sensor to bit",
    "grid": "Map grid",
}


@pytest.mark.parametrize(("field", "line"), LINES.items())
def test_what_is_not_given_of_a_well_prints_no_value(field, line):
    default = next(f.default for f in dataclasses.fields(example.WELL) if f.name == field)
    header = dict(example.table(well={field: default}).header)
    assert not re.search(r"\d", header.get(line, ""))
    assert header.get(line, "not given").startswith("not given")


@pytest.mark.parametrize("missing", ["declination", "convergence"])
def test_an_angle_between_norths_that_is_not_known_is_printed_nowhere(missing):
    well = dataclasses.replace(example.WELL, north_reference="true" if missing == "convergence" else "magnetic")
    whole = SurveyList(well=well, legs=(Leg(tie_on=GIVEN),))
    table = survey_table(whole.add(example.survey(1, 10.0, 40.0, **{missing: None}), 300.0, 0.4), example.MADE)
    line = {"declination": "Declination", "convergence": "Grid convergence"}[missing]
    assert not re.search(r"\d", dict(table.header)[line])
    xml = FORMATS["witsml"].make(table).decode()
    assert {"declination": "MagDeclUsed", "convergence": "GridConUsed"}[missing].lower() not in xml.lower()
    assert rows_of(FORMATS["raw_csv"].make(table))[0][f"{missing}_deg"] == ""


def test_a_tie_on_that_nobody_gave_prints_no_numbers():
    assert dict(example.table(tie_on=UNTIED).header)["Tie-on"] == "not given"
    assert "270.00 m MD" in dict(example.table(tie_on=GIVEN).header)["Tie-on"]
    assert math.isclose(example.table(tie_on=GIVEN).path.positions[0, 2], 269.5)
