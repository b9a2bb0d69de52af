# SPDX-License-Identifier: Apache-2.0
"""Surveys as plain tables: who accepted, gaps instead of stand-ins, lights that judge what the verdict judged."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from example_stations import DIP, B, listed, survey
from example_surveys import NO_AZIMUTH

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.page import state_json
from mwd_surface.page.state_json import path_table, quality_lights, survey_row
from mwd_surface.signals.table import SURVEY_TABLE
from mwd_surface.surveys.survey_list import SurveyList


def test_survey_rows_say_who_accepted_and_leave_the_path_empty_where_a_station_is_out():
    wrong = {"verdict": int(Verdict.DOUBTFUL), "reasons": ("dip is 0.6 deg off",), "dip": DIP + math.radians(0.6)}
    found = listed(survey(1), survey(2, **wrong), survey(3))
    found = found.accept(2, "A. Berg", "gyro agrees", 5).reject(3, "A. Berg", "moved", 6)
    one, two, three = (survey_row(record, North.GRID) for record in found.records)
    assert (one["verdict"], one["accepted_by"]) == ("accepted", "automatic")
    assert (two["verdict"], two["accepted_by"], two["automatic"]) == ("accepted", "A. Berg", "doubtful")
    assert (three["verdict"], three["in_use"], three["vertical_depth"]) == ("rejected", False, None)
    assert one["vertical_section"] is not None
    assert one["azimuth_north"] == "grid"


def test_a_row_has_the_verdict_of_each_quantity_the_reason_to_act_on_and_other_azimuths_from_the_same_north():
    odd = {
        "verdict": int(Verdict.DOUBTFUL),
        "verdict_azimuth": int(Verdict.DOUBTFUL),
        "verdict_toolface": int(Verdict.NOT_DETERMINED),
        "headline": "External field: use a gyro",
        "reasons": ("total field 380 nT over",),
        "hypotheses": ("external", "clean"),
        "hypothesis_odds": (0.9, 0.1),
    }
    plain = survey(1)
    shot = survey(1, **odd, alternatives=(plain.azimuth + 1.0,), alternative_odds=(0.2,))
    (record,) = listed(shot).records
    row = survey_row(record, North.GRID)
    assert row["verdicts"] == ["accept", "doubtful", "not determined"]
    assert row["headline"] == "External field: use a gyro"
    ((azimuth, odds),) = row["alternatives"]
    assert ((azimuth - row["azimuth"]) % math.tau, odds) == pytest.approx((1.0, 0.2))
    assert row["disturbances"] == [["steel outside the string", 0.9], ["nothing beyond the tool code", 0.1]]
    quality = quality_lights(record)
    assert (quality["headline"], quality["reasons"][0]) == ("External field: use a gyro", "total field 380 nT over")


def test_a_survey_without_magnetometer_depth_or_azimuth_shows_gaps_not_minus_one():
    bare = dataclasses.replace(survey(1, b_total=math.nan, dip=math.nan, b_reference=math.nan), **NO_AZIMUTH)
    (record,) = SurveyList().add(bare).records
    row = survey_row(record, North.TRUE)
    assert [row[k] for k in ("measured_depth", "azimuth", "sigma_azimuth", "b_total", "dip")] == [None] * 5
    lights = {light["name"]: light["light"] for light in quality_lights(record)["lights"]}
    assert lights == {"total gravity": "good", "total field": "not measured", "dip": "not measured"}


@pytest.mark.parametrize(("off_nt", "light"), [(0.0, "good"), (-299.0, "good"), (301.0, "doubtful"), (460.0, "reject")])
def test_the_lights_follow_the_limits(off_nt, light):
    (record,) = listed(survey(1, b_total=B + off_nt * 1e-9)).records
    field = quality_lights(record)["lights"][1]
    assert field["light"] == light
    assert field["deviation"] == pytest.approx(off_nt * 1e-9, abs=1e-12)
    assert field["limit"] == pytest.approx(300e-9)


def test_the_path_comes_with_its_projection_and_ellipses_of_ten_stations_at_most():
    found = listed(*(survey(k) for k in range(1, 16)))
    path = found.definitive(bit_depth=1520.0)
    got = path_table(path, path.section_azimuth, np.tile(np.diag([4.0, 1.0, 1.0]), (16, 1, 1)), 1000)
    assert got["kind"][-1] == "projected"
    assert len(got["north"]) == len(got["vertical_section"]) == 17
    assert 0 < len(got["ellipses"]) <= 10
    assert got["ellipses"][0]["plan"][:2] == pytest.approx([4.0, 2.0])
    assert got["north_reference"] == "grid"


def test_the_lights_stand_by_the_limits_of_the_verdict():
    own = {"g_limit": 0.0108, "b_limit": 520e-9, "dip_limit": 0.0082}
    (record,) = listed(survey(1, b_total=B + 380e-9, **own)).records
    gravity, field, dip = quality_lights(record)["lights"]
    assert [gravity["limit"], field["limit"], dip["limit"]] == [0.0108, 520e-9, 0.0082]
    assert field["light"] == "good"
    (record,) = listed(survey(1, b_total=B + 600e-9, **own, verdict=int(Verdict.DOUBTFUL))).records
    assert quality_lights(record)["lights"][1]["light"] == "doubtful"


def test_words_of_a_verdict_move_no_light():
    words = ("within limits: total field +380 nT off the reference (limit 520 nT)",)
    (record,) = listed(survey(1, b_total=B + 380e-9, reasons=words)).records
    field = quality_lights(record)["lights"][1]
    assert (field["limit"], field["light"]) == (pytest.approx(300e-9), "doubtful")


def test_a_limit_that_is_not_known_leaves_the_usual_one():
    (record,) = listed(survey(1, g_limit=math.nan, b_limit=520e-9)).records
    gravity, field, dip = quality_lights(record)["lights"]
    assert gravity["limit"] == pytest.approx(2.5e-3 * STANDARD_GRAVITY)
    assert field["limit"] == 520e-9
    assert dip["limit"] == pytest.approx(math.radians(0.45))


def test_every_unit_of_a_survey_has_a_kind_that_the_page_knows():
    text = (Path(state_json.__file__).parent / "static" / "units.js").read_text(encoding="utf-8")
    kinds = set(re.findall(r"^  (\w+): \[\[", text, re.MULTILINE))
    symbols = {signal.listed_scale.symbol for signal, _ in SURVEY_TABLE if signal.type == "Double"}
    assert symbols <= set(state_json._KINDS)
    assert set(state_json._KINDS.values()) <= kinds
    assert [column["title"] for column in state_json.COLUMNS][:3] == ["MD", "Inc", "Azi"]
