# SPDX-License-Identifier: Apache-2.0
"""Survey programmes: intervals and runs of a file, what it refuses, stations' own sigmas, the tie-on."""

import dataclasses
import math

import example_surveys as example
import numpy as np
import pytest

from mwd_estimation.core.north import North
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.uncertainty.error_terms import ErrorReference
from mwd_surface.uncertainty.position_covariance import position_covariance
from mwd_surface.uncertainty.programme import ProgrammeError, ProgrammeStations, SurveyProgramme, read_programme

REFERENCE = ErrorReference(math.radians(60), 50e-6, math.radians(72), math.radians(-4), math.radians(1.5), 9.80665)
MD = np.arange(0.0, 1501.0, 30.0)
INC, AZI = np.clip((MD - 300.0) / 900.0, 0.0, 1.0), np.full(MD.size, 1.0)
FILE = """
tie_on: {sigma_north_m: 2.0, sigma_east_m: 1.0}
intervals:
  - {to_m: 600, code: GYRO-NS, run: gyro}
  - {from_m: 600, to_m: 1200, code: MWD+IFR1+SAG, run: BHA 2}
  - {from_m: 1200, code: MWD+SRGM, methods: {gyro: GYRO-MWD}}
"""
OWN_SIGMAS = "intervals:\n  - {code: MWD+SRGM, angles: station}\n"


def written(tmp_path, text=FILE):
    path = tmp_path / "programme.yaml"
    path.write_text(text)
    return path


def programme(tmp_path, text=FILE):
    return read_programme(written(tmp_path, text))


def covariance(errors, first_tvd=0.0):
    return position_covariance(MD, INC, AZI, North.GRID, errors, REFERENCE, first_tvd)


def test_a_file_gives_each_station_its_tool_and_run(tmp_path):
    whole = programme(tmp_path)
    stations = ProgrammeStations.plain(MD)
    methods = list(stations.methods)
    methods[-1] = "gyro"
    tools = whole.errors(dataclasses.replace(stations, methods=methods)).tools
    by_depth = dict(zip(MD, tools, strict=True))
    assert (by_depth[0.0].code, by_depth[600.0].code, by_depth[630.0].code) == ("GYRO-NS", "GYRO-NS", "MWD+IFR1+SAG")
    assert (by_depth[630.0].run, by_depth[1230.0].run) == ("BHA 2", "interval 3")
    assert (by_depth[1470.0].code, by_depth[1500.0].code) == ("MWD+SRGM", "GYRO-MWD")


def test_another_tool_in_the_list_is_another_run():
    stations = ProgrammeStations.plain(MD)
    serials = ["A"] * 20 + ["B"] * (MD.size - 20)
    tools = SurveyProgramme.of_code("MWD+SRGM").errors(dataclasses.replace(stations, tools=serials)).tools
    assert len(set(tools)) == 2
    assert {t.code for t in tools} == {"MWD+SRGM"}


@pytest.mark.slow
def test_the_tie_on_is_added_to_every_station(tmp_path):
    whole = programme(tmp_path)
    exact = dataclasses.replace(whole, tie_on=type(whole.tie_on)())
    stations = ProgrammeStations.plain(MD)
    more = covariance(whole.errors(stations)) - covariance(exact.errors(stations))
    np.testing.assert_allclose(more, np.broadcast_to(np.diag([4.0, 1.0, 0.0]), more.shape), atol=1e-9)


def test_a_list_that_starts_deep_starts_with_a_tie_on_of_no_tool():
    errors = SurveyProgramme.of_code("MWD+SRGM").errors(ProgrammeStations.plain(MD[10:]))
    assert errors.tools[0] is None
    assert errors.tools[1] is not None


def test_a_leg_has_rows_of_its_own(tmp_path):
    rows = "intervals:\n  - {leg: T2, code: MWD+IFR2+SAG+MS, run: a}\n  - {code: MWD+SRGM, run: b}\n"
    stations = dataclasses.replace(ProgrammeStations.plain(MD[:3]), legs=["main", "main", "T2"])
    assert [t.run for t in programme(tmp_path, rows).errors(stations).tools] == ["b", "b", "a"]


def test_own_sigmas_replace_the_angles_of_the_code_and_keep_its_depth(tmp_path):
    own = programme(tmp_path, OWN_SIGMAS)
    small = dataclasses.replace(ProgrammeStations.plain(MD), sigmas=np.full((MD.size, 2), math.radians(1e-4)))
    large = dataclasses.replace(small, sigmas=np.full((MD.size, 2), math.radians(1.0)))
    few, many = (covariance(own.errors(stations))[-1] for stations in (small, large))
    code = covariance(SurveyProgramme.of_code("MWD+SRGM").errors(small))[-1]
    # Depth stands; a degree at every station of the same run shifts the end by a degree of the way, in the vertical
    # part too: the direction is as uncertain there across the hole's later azimuth as along it.
    assert 0.35**2 < few[2, 2] < code[2, 2]
    assert np.trace(few) < np.trace(code)
    across = math.radians(1.0) * float(np.sum(np.where(INC[1:] > 0.0, np.sin(INC[1:]), 1.0) * 30.0))
    side = np.array([-math.sin(1.0), math.cos(1.0), 0.0])
    assert math.sqrt(side @ (many - few) @ side) == pytest.approx(across, rel=0.02)


def test_a_station_without_a_sigma_of_its_own_is_refused(tmp_path):
    with pytest.raises(ProgrammeError, match=r"the station at 30.0 m has no sigma of its own"):
        programme(tmp_path, OWN_SIGMAS).errors(ProgrammeStations.plain(MD))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("intervals: []", "expected a table with intervals"),
        ("- a", "expected a table with intervals"),
        ("intervals: [{code: MWD+SRGN}]", "did you mean MWD"),
        ("intervals: [{code: MWD+SRGM, until: 3.0}]", "until"),
        ("intervals: [{code: MWD+SRGM, from_m: 500, to_m: 400}]", "interval 1 ends at 400 m"),
        ("intervals: [{code: MWD+SRGM, angles: own}]", "'own' is not allowed"),
        ("intervals: [{code: MWD+SRGM}]\ntie_on: {covariance_m2: [[1.0, 0.0], [0.0, 1.0]]}", "3 x 3"),
        ("{", "not YAML"),
    ],
)
def test_a_file_that_cannot_be_used_is_told_in_a_sentence(tmp_path, text, words):
    with pytest.raises(ProgrammeError, match=words):
        programme(tmp_path, text)


def test_a_gap_in_the_programme_names_the_station(tmp_path):
    with pytest.raises(ProgrammeError, match=r"programme.yaml: no interval covers the station at 630.0 m"):
        programme(tmp_path, "intervals: [{code: MWD+SRGM, to_m: 600}]").errors(ProgrammeStations.plain(MD))


def test_the_programme_of_a_well_stands_in_its_table(tmp_path):
    path = written(tmp_path, "intervals:\n  - {code: MWD+IFR2+SAG+MS}\n")
    table = survey_table(example.surveys(dataclasses.replace(example.WELL, programme=str(path))), example.MADE)
    assert table.covariance_note.startswith("survey programme programme.yaml")
    usual = example.table()
    assert np.trace(table.covariance[-1]) < np.trace(usual.covariance[-1])
    path.unlink()
    table = survey_table(example.surveys(dataclasses.replace(example.WELL, programme=str(path))), example.MADE)
    assert table.covariance is None
    assert "No such file" in table.covariance_note
