# SPDX-License-Identifier: Apache-2.0
"""What an azimuth is made of follows from what the estimator sends, and every rig interface says the same."""

import dataclasses
import math
import re

import example_surveys as example
import pytest
from example_decided import decided

from mwd_estimation.core.north import North
from mwd_surface.exports.export_witsml import witsml
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.rig.survey import accepted_surveys
from mwd_surface.rig.values import nothing_yet, survey_values
from mwd_surface.rig.wits.records import RecordWriter, Wits0Format
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.survey_list import SurveyList


def rig_words(survey):
    """Item 0712, and the WITSML facts, of a list with this survey alone."""
    north = North(survey.north).name.lower()
    surveys = SurveyList(well=dataclasses.replace(example.WELL, north_reference=north)).add(survey, 300.0, 0.0)
    surveys = surveys if surveys.records[0].in_use else surveys.accept(survey.sequence, "Bo", "test", 2 * 10**18)
    (accepted,) = accepted_surveys(surveys)
    items = dict(RecordWriter(Wits0Format()).survey(nothing_yet(), accepted))
    share = survey_values(accepted, accepted.result.stamp_ns)["survey_gyro_share"].value
    assert share == azimuth_source(survey).gyro_share
    document = witsml(survey_table(surveys, 2 * 10**18))
    found = {
        tag: re.findall(f"<{tag}>([^<]*)</{tag}>", document)
        for tag in ("axialMagInterferenceCorUsed", "MSACorUsed", "typeTrajStation")
    }
    return items[712], found


@pytest.mark.parametrize(
    ("given", "wits", "axial", "kind"),
    [
        ({}, "MAG-AX", "true", "magnetic MWD"),
        ({"reference": None}, "MWD", "false", "magnetic MWD"),
        ({"gyro_sigma": math.radians(0.1)}, "MAG+GYRO", "true", "gyro MWD"),
        ({"gyro_sigma": math.radians(60.0)}, "MAG-AX", "true", "magnetic MWD"),
        ({"gyro_sigma": math.radians(0.3), "magnetometer": False}, "GYRO", "false", "gyro MWD"),
    ],
)
def test_the_rig_hears_what_took_part_in_the_azimuth(given, wits, axial, kind):
    item, facts = rig_words(decided(**given))
    assert item == wits
    assert facts["axialMagInterferenceCorUsed"] == [axial]
    assert "true" not in facts["MSACorUsed"]
    assert kind in facts["typeTrajStation"]


def test_the_share_of_the_gyro_is_that_of_the_estimator_and_grows_as_the_gyro_is_better():
    found = [azimuth_source(decided(gyro_sigma=math.radians(sigma))) for sigma in (2.0, 0.5, 0.2)]
    assert [one.gyro_share for one in found] == sorted(one.gyro_share for one in found)
    assert [one.mostly_gyro for one in found] == [False, True, True]
    assert all(one.magnetic and one.by_gyro and one.corrected for one in found)
    assert found[0].words.startswith("magnetic, corrected; gyro ")


@pytest.mark.parametrize("method", ["", "link", "none"])
def test_of_an_azimuth_that_nobody_explained_nothing_is_claimed(method):
    source = azimuth_source(dataclasses.replace(decided(), azimuth_method=method))
    assert (source.words, source.by_gyro, source.magnetic, source.corrected) == ("", False, False, False)


def test_methods_of_older_lists_keep_their_meaning():
    words = {m: azimuth_source(example.survey(1, 30.0, 75.0, azimuth_method=m)).words for m in ("raw", "msa", "gyro")}
    assert words == {"raw": "magnetic", "msa": "magnetic, multi-station", "gyro": "gyro"}
