# SPDX-License-Identifier: Apache-2.0
"""Rotation shots and check shots in a survey list, its report and `mwd survey`."""

import csv
import dataclasses

import example_surveys as example
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core.frames import mat_nt
from mwd_surface.commands.survey import survey as survey_command
from mwd_surface.exports.report_content import content
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.surveys.check_shots import sentence, shots_of
from mwd_surface.surveys.survey_list import SurveyList

FIELD_N = np.array([15.5e-6, 0.0, 47.8e-6])
FACES = (0.2, 1.8, 3.3, 4.9)


def _readings(toolface, bias_nt=0.0):
    mat = mat_nt(0.7, 1.2, toolface)
    return mat.T @ [0.0, 0.0, -9.81], mat.T @ FIELD_N + [0.0, bias_nt * 1e-9, 0.0]


def _list(bias_nt=0.0, **changes):
    """Four surveys at one depth with the tool turned, and one 30 m above."""
    whole = SurveyList(well=example.WELL, tool="T-0042")
    for k, face in enumerate((2.0, *FACES), 1):
        force, field = _readings(face, bias_nt)
        readings = {"specific_force": tuple(map(float, force)), "magnetic_field": tuple(map(float, field))}
        whole = whole.add(
            example.survey(k, 40.0, 70.0, **readings, **(changes if k == 3 else {})), 970.0 + 30.0 * (k > 1), 0.4
        )
    return whole


def test_a_good_rotation_shot_passes_and_is_in_the_report():
    whole = _list()
    ((shot, numbers),) = shots_of(whole.records, "MWD+SRGM")
    assert (numbers, shot.verdict) == ((2, 3, 4, 5), "pass")
    assert sentence(shot).startswith("1000.0 m, rotation shot of 4 surveys: pass")
    found = next(s for s in content(survey_table(whole, example.MADE)).sheets if s.heading.startswith("Rotation shots"))
    assert found.rows[0][:2] == ("1000.00", "2, 3, 4, 5")
    assert (found.rows[0][2], found.rows[0][11]) == ("", "pass")
    assert all(len(row) == len(found.titles) for row in found.rows)


def test_a_bias_is_named_with_what_the_tool_code_allows():
    ((shot, _),) = shots_of(_list(600.0).records, "MWD+SRGM")
    assert shot.verdict != "pass"
    assert "magnetometer y bias +600" in sentence(shot)
    assert "(1 sigma of the tool code 70)" in sentence(shot)


def test_a_rejected_survey_and_another_tool_are_told_apart():
    ((_, numbers),) = shots_of(_list(verdict=int(Verdict.REJECT)).records, "GYRO-NS")
    assert numbers == (2, 4, 5)
    records = [dataclasses.replace(r, tool="B" if r.survey.sequence > 3 else r.tool) for r in _list().records]
    ((shot, _),) = shots_of(records, "MWD+SRGM")
    assert "check shot by T-0042 and B" in sentence(shot)
    report = content(survey_table(dataclasses.replace(_list(), records=tuple(records)), example.MADE))
    found = next(s for s in report.sheets if s.heading.startswith("Rotation shots"))
    assert found.rows[0][2] == "T-0042 and B"


def test_a_list_without_repeated_surveys_has_no_such_section():
    assert not any(s.heading.startswith("Rotation shots") for s in content(example.table()).sheets)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("runs", "bias_nt", "said"),
    [
        (("one", "one", "two", "two"), 0.0, "check shot by one and two of 4 surveys: pass"),
        (None, 0.0, "rotation shot of 4 surveys: pass"),
        (None, 600.0, "rotation shot of 4 surveys: fail"),
    ],
)
def test_mwd_survey_says_what_repeated_rows_show(tmp_path, runs, bias_nt, said):
    path = tmp_path / "table.csv"
    sensors = [f"{name}_{axis}" for name in ("accel", "mag") for axis in ("axial", "tran1", "tran2")]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["md_m", *(["run"] if runs else []), *sensors])
        for k, face in enumerate(FACES):
            force, field = _readings(face, bias_nt)
            writer.writerow([1000.0, *([runs[k]] if runs else []), *force, *(1e9 * field)])
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(survey_command)
    done = CliRunner(env={"COLUMNS": "140"}).invoke(app, [str(path), "--field", "50250,72.0,0.0"])
    assert f"1000.0 m, {said}" in done.stdout
