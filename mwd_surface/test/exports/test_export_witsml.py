# SPDX-License-Identifier: Apache-2.0
"""The WITSML trajectory against its schema, against what the schema does not check, and back as a plan."""

import dataclasses
import functools
import itertools
import math

import example_surveys as example
import numpy as np
import pytest
from lxml import etree

from mwd_estimation.survey.survey import ROTARY
from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.export_witsml import NAMESPACE, witsml
from mwd_surface.exports.survey_table import survey_table, table_of
from mwd_surface.list_files.list_file import list_of
from mwd_surface.surveys.imported_list import survey_list
from mwd_surface.surveys.leg import Origin, TieOn
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Well
from project import REFERENCE_DATA

XSD = REFERENCE_DATA / "witsml" / "xsd" / "obj_trajectory.xsd"
NS = {"w": NAMESPACE}


@functools.cache
def schema():
    return etree.XMLSchema(etree.parse(XSD))


def checked(text):
    """The document, valid, every measure finite, uids its own, angles in range, depth increasing."""
    root = etree.fromstring(text.encode())
    assert schema().validate(root), schema().error_log
    for element in root.iter():
        if element.get("uom") is not None:
            assert math.isfinite(float(element.text)), element.tag
    stations = root.findall(".//w:trajectoryStation", NS)
    uids = [s.get("uid") for s in stations]
    assert None not in uids
    assert len(set(uids)) == len(uids)
    depths = [float(s.findtext("w:md", namespaces=NS)) for s in stations]
    assert all(b > a for a, b in itertools.pairwise(depths))
    assert all(0.0 <= float(s.findtext("w:azi", namespaces=NS)) < 360.0 for s in stations)
    assert all(0.0 <= float(s.findtext("w:incl", namespaces=NS)) <= 180.0 for s in stations)
    return root


def station(root, k):
    return root.findall(".//w:trajectoryStation", NS)[k]


def text(element, path):
    return element.findtext("/".join(f"w:{tag}" for tag in path.split("/")), namespaces=NS)


def test_the_trajectory_is_valid_and_says_what_each_station_is():
    root = checked(witsml(example.table()))
    assert text(station(root, 0), "typeTrajStation") == "tie in point"
    assert text(station(root, 1), "typeTrajStation") == "magnetic MWD"
    bit = station(root, -1)
    assert text(bit, "typeTrajStation") == "hold to MD"
    assert text(bit, "commonData/comments") == "projected to the bit, not surveyed"
    assert text(root[0], "aziRef") == "grid north"
    assert text(station(root, 1), "magModelUsed") == "WMM2025 2026-05-14"
    assert text(root[0], "nameWell") == "Åsgard Ω-1"
    assert station(root, 1).get("uid") == example.survey(1, 0, 0).uuid


def test_raw_gravity_points_down_and_corrections_carry_their_sign():
    root = checked(witsml(example.table()))
    one = station(root, 1)
    assert float(text(one, "rawData/gravAxialRaw")) > 9.7
    assert text(one, "rawData/magTran1Raw") == "-12000.0"
    assert text(one, "corUsed/magAxialDrlstrCor") == "-850.0"
    assert text(one, "axialMagInterferenceCorUsed") == "true"
    assert text(one, "matrixCov/varianceVertVert") is not None


def test_a_rotary_survey_has_no_toolface_rather_than_a_zero():
    still, turning = example.surveys(), SurveyList(well=example.WELL)
    turning = turning.add(example.survey(1, 30.0, 75.0, kind=ROTARY), 300.0, 0.0)
    for whole, expected in ((still, True), (turning, False)):
        root = checked(witsml(survey_table(whole, whole.changed_ns)))
        assert [text(station(root, 1), tag) is not None for tag in ("gtf", "mtf")] == [expected, expected]


def test_a_persons_judgement_stands_in_the_comments():
    root = checked(witsml(example.table()))
    notes = [text(s, "commonData/comments") or "" for s in root.findall(".//w:trajectoryStation", NS)]
    assert any("automatic verdict doubtful" in n and "judged by Aslaug: -casing; gyro agrees" in n for n in notes)


def test_a_gyro_survey_and_a_curved_projection_have_their_own_types():
    whole = dataclasses.replace(example.surveys(), rules=ListRules(projection="curve"))
    gyro = dataclasses.replace(example.survey(13, 44.0, 80.0), azimuth_method="gyro")
    root = checked(witsml(survey_table(whole.add(gyro, 660.0, 0.1), example.MADE)))
    assert text(station(root, -1), "typeTrajStation") == "DLS and toolface to MD"
    assert text(station(root, -2), "typeTrajStation") == "gyro MWD"


@pytest.mark.parametrize("name", ["x" * 300, "<&>\"'", "a\x00b\nc", " ", "Ω" * 100, "\ud800"])
def test_any_name_of_a_well_leaves_the_file_valid(name):
    root = checked(
        witsml(example.table(well={"name": name, "wellbore": name, "service_company": name, "company": name}))
    )
    assert 1 <= len(text(root[0], "nameWell")) <= 64


@pytest.mark.fault_case(91)
@pytest.mark.parametrize(
    ("column", "value", "reason"),
    [
        ("inclination", math.nan, "station 3 (survey 3) omitted: a number in it is not finite"),
        ("azimuth", math.nan, "station 3 (survey 3) omitted: a number in it is not finite"),
        # Its depth is printed as that of the station before.
        ("md", 330.00001, "not deeper than the previous station"),
    ],
)
def test_a_station_that_cannot_be_written_is_left_out_with_its_reason_and_the_file_is_valid(column, value, reason):
    whole = example.surveys()
    path = whole.definitive()
    third = np.arange(path.md.size) == 3
    broken = dataclasses.replace(path, **{column: np.where(third, value, getattr(path, column))})
    root = checked(witsml(table_of(whole, broken, example.MADE)))
    assert len(root.findall(".//w:trajectoryStation", NS)) == path.md.size - 1
    assert reason in text(root[0], "commonData/comments")


def test_an_empty_list_and_equal_uuids_are_valid():
    checked(witsml(survey_table(SurveyList(), example.MADE)))
    tied = SurveyList().tied_on(TieOn(100.0, 0.1, 0.2, 1.0, 2.0, 99.0, Origin.GIVEN))
    checked(witsml(survey_table(tied.sidetracked("ST 1", 100.0), example.MADE)))


def test_what_is_exported_comes_back_as_a_list():
    table = example.table()
    read = list_of(witsml(table).encode())
    surveyed = slice(1, read.md.size + 1)
    assert read.north == "grid"
    np.testing.assert_allclose(read.positions, table.path.positions[surveyed], atol=2e-3)
    np.testing.assert_allclose(read.md, table.path.md[surveyed], atol=1e-3)


@pytest.mark.parametrize("units", ["metric", "field"])
def test_an_imported_list_without_times_is_valid_and_claims_no_tool(units):
    rows = b"md_m,inclination_deg,azimuth_true\n0,0,45\n300,10,45\n330,12,46\n360,14.5,47\n"
    surveys = survey_list(list_of(rows, "list.csv"), Well(units=units))
    root = checked(FORMATS["witsml"].make(survey_table(surveys, example.MADE)).decode())
    assert root.find(".//w:dTimTrajStart", NS) is None
    assert root.find(".//w:dTimStn", NS) is None
    assert text(station(root, -1), "typeTrajStation") == "unknown"
    wanted = {"metric": ("m", "dega/30m"), "field": ("ft", "dega/100ft")}[units]
    assert {s.get("uom") for s in root.iterfind(".//w:md", NS)} == {wanted[0]}
    assert {s.get("uom") for s in root.iterfind(".//w:dls", NS)} == {wanted[1]}
