# SPDX-License-Identifier: Apache-2.0
"""`mwd forecast`: table and picture, and what it refuses."""

import csv

import pytest
from typer.testing import CliRunner

from mwd_surface.cli import app

pytestmark = pytest.mark.slow

FIELD = ("--field", "50500,71.2,-1.1")


def mwd(*words):
    return CliRunner().invoke(app, ["forecast", *map(str, words)])


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "plan.csv"
    path.write_text("md_m,inc_deg,azi_deg\n0,0,90\n30,0,90\n150,90,90\n180,90,90\n")
    return path


def test_table_and_picture_are_written_and_the_no_go_part_is_told(plan, tmp_path):
    done = mwd(plan, "-o", tmp_path / "out", "--code", "MWD+IFR1+SAG", *FIELD)
    assert done.exit_code == 0, done.output
    assert "the axial correction is not useful at" in done.stdout.replace("\n", " ")
    with (tmp_path / "out" / "forecast.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(rows[0]["md_m"]), float(rows[-1]["md_m"])] == [0.0, 180.0]
    assert rows[0]["sigma_azimuth_deg"] == ""
    assert {row["correction_no_go"] for row in rows} == {"yes", "no"}
    assert float(rows[0]["accepted"]) == 1.0
    assert float(rows[-1]["accepted"]) < 1.0
    assert (tmp_path / "out" / "forecast.png").read_bytes().startswith(b"\x89PNG")


def test_a_gyro_is_forecast_without_limits(plan, tmp_path):
    plan.write_text("md_m,inc_deg,azi_deg\n0,0,90\n30,0,90\n120,45,90\n")
    place = ("--lat", 58.4, "--lon", 1.9, "--date", "2026-03-01")
    done = mwd(plan, "-o", tmp_path / "out", "--code", "GYRO-NS", *place)
    assert done.exit_code == 0, done.output
    assert (tmp_path / "out" / "forecast.png").exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "needs the field"),
        ((*FIELD, "--code", "MWD+IFR9"), "did you mean"),
        ((*FIELD, "--north", "up"), "--north: 'up'"),
        ((*FIELD, "--limit", 0), "must be positive"),
        ((*FIELD, "--code", "GYRO-NS"), "is meant for inclinations from 0 to 89 deg"),
        ((*FIELD, "--north", "grid"), "need the convergence"),
    ],
)
def test_what_cannot_be_forecast_is_told_in_a_sentence(plan, tmp_path, words, sentence):
    done = mwd(plan, "-o", tmp_path / "out", *words)
    assert sentence in str(done.exception)
