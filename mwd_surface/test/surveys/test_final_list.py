# SPDX-License-Identifier: Apache-2.0
"""The final list: overlaps are decided by uncertainty, disagreements named, nothing measured is lost."""

import dataclasses
import functools
import itertools
import math

import example_surveys as example
import numpy as np
import pytest

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_surface.surveys.final_list import ListSource, final_list
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Value
from mwd_surface.surveys.well_position import programme_stations


@functools.cache
def two_legs(kick_off_m=500.0):
    """The example well with a sidetrack of six stations below its kick-off."""
    whole = example.surveys(dataclasses.replace(example.WELL, error_model="MWD+SRGM"))
    whole = whole.sidetracked("ST1", kick_off_m)
    for k in range(20, 26):
        whole = whole.add(example.survey(k, 28.0 + (k - 20), 70.0), 530.0 + 30.0 * (k - 20), 0.4)
    return whole


@functools.cache
def gyro(turn_deg=0.0, first_m=300.0, last_m=680.0):
    """A gyro survey of the sidetrack, turned from the hole by an angle."""
    path = two_legs().definitive("ST1")
    whole = SurveyList(well=dataclasses.replace(example.WELL, error_model="GYRO-NS"))
    md = [first_m + 20.0 * k for k in range(1, int((last_m - first_m) / 20.0) + 1)]
    for k, depth in enumerate(md, 1):
        inclination, azimuth, _ = path.at(min(depth, float(path.md[-1])))
        azimuth = (azimuth + math.radians(turn_deg)) % math.tau
        known = example.survey(1, 10.0, 10.0)
        reference = {name: getattr(known, name) for name in ("b_reference", "dip_reference", "g_reference")}
        survey = Survey(
            k, f"gyro-{k}", k, inclination, azimuth, int(North.GRID), declination=0.0, convergence=0.0, **reference
        )
        whole = whole.add(survey, depth, 0.0)
    return whole


@functools.cache
def with_a_surer():
    """The final list of the run and of a survey that is more certain."""
    return final_list([ListSource("run", two_legs(), "MWD+SRGM"), ListSource("ifr", gyro(), "MWD+IFR1+MS")])


def test_in_an_overlap_the_surer_survey_is_used_and_the_other_stays_in_the_list():
    whole, final = two_legs(), with_a_surer()
    (overlap,) = final.overlaps
    assert (overlap.used, overlap.left_out, overlap.apart) == ("ifr", "run", ())
    assert overlap.sigma_used < overlap.sigma_left_out
    assert len(final.surveys.records) == len(whole.records) + len(gyro().records)
    on_path = set(final.surveys.definitive().sequence)
    used = [r for r in final.surveys.records if r.in_use and r.survey.sequence in on_path]
    inside = [r for r in used if overlap.from_m <= r.measured_depth <= overlap.to_m]
    assert {r.tool for r in inside} == {"ifr"}
    # Above the kick-off at 500 m the stations belong to the leg that the sidetrack leaves.
    assert {r.leg for r in inside if r.measured_depth <= 500.0} == {"main"}
    assert {r.leg for r in inside if r.measured_depth > 500.0} == {"ST1"}
    left = [r for r in final.surveys.records if not r.in_use and "replaced by ifr" in r.comment]
    assert left
    # The programme gives every station in use its own code.
    codes = {interval.code for interval in final.programme.intervals}
    assert codes == {"MWD+IFR1+MS", "MWD+SRGM"}
    # Stations below the kick-off in the hole that was left stay in use.
    below = [r.survey.uuid for r in whole.records if r.leg != "ST1" and r.in_use and r.measured_depth > 500.0]
    assert below
    assert set(below) <= {r.survey.uuid for r in final.surveys.records if r.in_use}


@pytest.mark.parametrize(("turn_deg", "apart"), [(0.3, False), (25.0, True)])
def test_surveys_that_disagree_beyond_their_errors_are_named(turn_deg, apart):
    final = final_list([ListSource("run", two_legs(), "MWD+SRGM"), ListSource("gyro", gyro(turn_deg), "GYRO-NS")])
    assert bool(final.overlaps[0].apart) == apart


def bare(turn_deg=0.0, first_m=300.0, last_m=680.0, **well):
    """The gyro survey as tables give it: no station has a reference field, and the list may state no place."""
    whole = gyro(turn_deg, first_m, last_m)
    unknown = dict.fromkeys(("b_reference", "dip_reference", "g_reference"), math.nan)
    records = [dataclasses.replace(r, survey=dataclasses.replace(r.survey, **unknown)) for r in whole.records]
    place = {"latitude_deg": None, "longitude_deg": None, **well}
    return whole.with_records(records).configured(dataclasses.replace(whole.well, **place), whole.rules)


def test_a_gyro_table_without_a_reference_field_may_cover_the_whole_run():
    run = two_legs()
    depths = [r.measured_depth for r in run.records if r.in_use]
    whole = bare(first_m=min(depths) - 20.0)
    final = final_list([ListSource("run", run, "MWD+SRGM"), ListSource("gyro", whole, "GYRO-NS")])
    assert all(math.isfinite(sigma) for one in final.overlaps for sigma in (one.sigma_used, one.sigma_left_out))


@pytest.mark.parametrize("shift_m", [-0.0001, 0.0, 0.0001])
def test_the_rounding_of_a_depth_does_not_make_two_stations_of_one(shift_m):
    run = two_legs()
    depths = sorted(r.measured_depth for r in run.records if r.in_use and r.leg == "ST1")
    theirs = bare(first_m=depths[-1] - 20.0, last_m=depths[-1])
    theirs = theirs.with_records(
        dataclasses.replace(r, measured_depth=r.measured_depth + shift_m) for r in theirs.records
    )
    final = final_list([ListSource("run", run, "MWD+SRGM"), ListSource("gyro", theirs, "GYRO-NS")])
    assert min(b - a for a, b in itertools.pairwise(final.surveys.definitive().md)) > 1.0
    assert len(final.overlaps) == 1


def test_lists_of_two_places_are_refused_and_a_joint_that_no_hole_has_is_named():
    run = two_legs()
    where = run.well.latitude_deg, run.well.longitude_deg
    far = bare(latitude_deg=where[0] - 5.0, longitude_deg=where[1])
    with pytest.raises(ValueError, match="gyro"):
        final_list([ListSource("run", run, "MWD+SRGM"), ListSource("gyro", far, "GYRO-NS")])
    for turn_deg, remarks in ((0.3, 0), (170.0, 1)):
        near = bare(turn_deg, first_m=680.0, last_m=760.0, latitude_deg=where[0] + 0.01, longitude_deg=where[1])
        final = final_list([ListSource("run", run, "MWD+SRGM"), ListSource("gyro", near, "GYRO-NS")])
        assert sum("implausible" in one for one in final.remarks) == remarks


def test_the_order_of_the_sources_decides_no_overlap():
    back = final_list([ListSource("ifr", gyro(), "MWD+IFR1+MS"), ListSource("run", two_legs(), "MWD+SRGM")])
    for final in (with_a_surer(), back):
        assert [one.used for one in final.overlaps] == ["ifr"]


def test_a_survey_that_two_recordings_have_is_used_once_and_a_person_is_obeyed():
    whole = two_legs()
    moved = dataclasses.replace(whole.find(21).survey, azimuth=whole.find(21).survey.azimuth + 0.01, revision=1)
    decided = whole.revise(moved).accept(21, "Ann", "the first was right", 5, value=Value.FIRST)
    final = final_list([ListSource("a", decided, "MWD+SRGM"), ListSource("b", whole, "MWD+SRGM")])
    assert len(final.surveys.records) == len(whole.records)
    assert final.surveys.find(21).survey.azimuth == whole.find(21).survey.azimuth
    assert final.remarks[-1] == "b: none of its stations is used"


def test_without_any_tool_code_the_reason_names_the_argument():
    bare = two_legs()
    bare = bare.configured(dataclasses.replace(bare.well, error_model=""), bare.rules)
    with pytest.raises(ValueError, match="run=CODE"):
        final_list([ListSource("run", bare, "")])


def test_a_run_gets_an_azimuth_by_multi_station_analysis_in_its_own_north():
    final = final_list([ListSource("run", two_legs(), "MWD+SRGM")])
    with_msa = [r for r in final.surveys.records if any(a.method == "msa" for a in r.survey.azimuths)]
    assert len(with_msa) == len(final.surveys.records)
    assert all(a.north == r.survey.north for r in with_msa for a in r.survey.azimuths if a.method == "msa")
    assert all(Verdict(r.survey.verdict) for r in with_msa if r.survey.sequence == 6)


@pytest.mark.parametrize(("turn_deg", "named"), [(0.0, False), (20.0, True)])
def test_a_multi_station_analysis_that_contradicts_the_list_is_named(turn_deg, named):
    run = SurveyList(well=dataclasses.replace(example.WELL, error_model="MWD+SRGM"))
    field = 5.03e-5 * np.array([math.cos(math.radians(72.1)), 0.0, math.sin(math.radians(72.1))])
    for k in range(1, 9):
        inclination, azimuth, toolface = math.radians(8.0 + 7.0 * k), math.radians(40.0 + 5.0 * k), 1.9 * k
        along = np.array(
            [
                math.sin(inclination) * math.cos(azimuth),
                math.sin(inclination) * math.sin(azimuth),
                math.cos(inclination),
            ]
        )
        high = np.array([math.cos(azimuth), math.sin(azimuth), 0.0]) / math.cos(inclination) - along * math.tan(
            inclination
        )
        scribe = math.cos(toolface) * high + math.sin(toolface) * np.cross(along, high)
        axes = np.array([along, np.cross(scribe, along), scribe])
        reading = {"specific_force": (-9.819 * axes[:, 2]).tolist(), "magnetic_field": (axes @ field).tolist()}
        reading = {name: tuple(vector) for name, vector in reading.items()}
        written = azimuth + math.radians(turn_deg)
        one = example.survey(k, math.degrees(inclination), 0.0, azimuth=written, **reading)
        run = run.add(one, 300.0 + 30.0 * k, 0.4)
    final = final_list([ListSource("run", run, "MWD+SRGM")])
    msa = [a.azimuth for r in final.surveys.records for a in r.survey.azimuths if a.method == "msa"]
    assert np.degrees(msa) == pytest.approx(40.0 + 5.0 * np.arange(1, 9), abs=0.1)
    assert any("contradict" in one for one in final.remarks) == named


def test_a_kick_off_below_which_the_parent_ends_moves_with_the_path_that_is_used():
    whole = two_legs(480.0)
    below = [r.leg == "main" and r.measured_depth > 480.0 for r in whole.records]
    ends = whole.with_records(
        [dataclasses.replace(r, in_use=r.in_use and not b) for r, b in zip(whole.records, below, strict=True)]
    )
    # Stations from 310 m in steps of 20 m: none at the kick-off.
    final = final_list([ListSource("run", ends, "MWD+SRGM"), ListSource("ifr", gyro(2.0, 290.0), "MWD+IFR1+MS")])
    assert final.overlaps[0].used == "ifr"
    parent, sidetrack = final.surveys.definitive("main"), final.surveys.definitive()
    assert sidetrack.at(480.0)[2] == pytest.approx(parent.at(480.0)[2], abs=1e-9)
    assert parent.at(480.0)[2] != pytest.approx(ends.definitive("main").at(480.0)[2], abs=1e-2)


def test_a_kick_off_between_two_stations_of_a_source_has_the_tool_code_of_that_source():
    final = with_a_surer()
    path = final.surveys.definitive()
    kick_off = path.sequence.index(0, 1)
    around = {final.sources[path.sequence[k]] for k in (kick_off - 1, kick_off + 1)}
    assert around == {"ifr"}
    stations = programme_stations(final.surveys, path)
    tool = final.programme.errors(stations).tools[kick_off]
    assert tool is not None
    assert tool.code == "MWD+IFR1+MS"
