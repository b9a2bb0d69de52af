# SPDX-License-Identifier: Apache-2.0
"""`mwd clearance`: the files it writes, the level it ends with, and what it refuses."""

import csv
import dataclasses

import example_surveys as example
import pytest
from typer.testing import CliRunner

from mwd_surface.cli import app
from mwd_surface.surveys.survey_store import SurveyStore

pytestmark = pytest.mark.slow

NEAR = "{name: A-3, file: beside.csv, north_m: -20.0, planned: true}"
FAR = "{name: A-2, file: straight.csv, north_m: 900.0, planned: true}"


def mwd(*words):
    return CliRunner().invoke(app, ["clearance", *map(str, words)])


@pytest.fixture
def folder(tmp_path):
    with SurveyStore(tmp_path / "run") as store:
        store.save(example.surveys())
    (tmp_path / "straight.csv").write_text("md_m,inc_deg,azi_grid_deg\n0,0,0\n300,0,0\n900,0,0\n")
    rows = "\n".join(f"{30 * k},{max(0.0, 4.0 * (k - 11))},79" for k in range(25))
    (tmp_path / "beside.csv").write_text(f"md_m,inc_deg,azi_grid_deg\n{rows}\n")
    (tmp_path / "wells.yaml").write_text(f"wells:\n  - {FAR}\n  - {NEAR}\n")
    (tmp_path / "far.yaml").write_text(f"wells: [{FAR}]\nahead_m: 60.0\nrule: {{warning_factor: 2.0}}\n")
    (tmp_path / "programme.yaml").write_text("intervals: [{code: MWD+IFR2+SAG+MS}]\n")
    return tmp_path


def read(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_table_and_pictures_are_written_and_stop_is_a_status(folder):
    done = mwd(folder / "run", "--offsets", folder / "wells.yaml", "-o", folder / "out")
    assert done.exit_code == 1, done.output
    assert "stop" in done.stdout
    rows = read(folder / "out" / "clearance.csv")
    assert [rows[0]["offset_well"], rows[-1]["offset_well"]] == ["A-3", "A-2"]
    assert {row["level"] for row in rows} >= {"stop", "clear"}
    for name in ("ladder.png", "travelling_cylinder.png", "plan_view.png"):
        assert (folder / "out" / name).read_bytes().startswith(b"\x89PNG")


def test_a_well_that_cannot_be_compared_is_not_clear(folder):
    """Map coordinates instead of distances from the wellhead: the other well is clear, and the status still 1."""
    map_coordinates = "{name: A-4, file: straight.csv, north_m: 6478566.0, east_m: 435050.0, planned: true}"
    (folder / "map.yaml").write_text(f"wells:\n  - {FAR}\n  - {map_coordinates}\n")
    done = mwd(folder / "run", "--offsets", folder / "map.yaml", "-o", folder / "out")
    assert done.exit_code == 1
    assert "offset well A-4: its wellhead lies 6493.2 km away" in " ".join(done.output.split())


def test_the_plan_ahead_is_compared_too_and_a_programme_counts(folder):
    """The wells are far apart: no error."""
    ends, allowed = [], []
    for extra in ((), ("--plan", folder / "beside.csv"), ("--programme", folder / "programme.yaml")):
        done = mwd(folder / "run", "--offsets", folder / "far.yaml", "-o", folder / "out", *extra)
        assert done.exit_code == 0, done.output
        rows = read(folder / "out" / "clearance.csv")
        ends.append(max(float(row["md_m"]) for row in rows))
        allowed.append(float(rows[-1]["allowed_distance_m"]))
    assert ends[0] == 642.5
    assert 642.5 < ends[1] <= 702.5
    assert allowed[2] < allowed[0]


def test_what_cannot_be_compared_is_told_in_a_sentence(folder):
    (folder / "same.yaml").write_text("wells: [{name: A-9, file: straight.csv}]\n")
    words = [folder / "run", "--offsets", folder / "same.yaml", "-o", folder / "out"]
    assert "none of the wells can be compared" in str(mwd(*words).exception)
    words[2] = folder / "far.yaml"
    assert "first run mwd path" in str(mwd(folder / "beside.csv", *words[1:]).exception)
    assert "give only one of them" in str(mwd(*words, "--programme", "a", "--code", "b").exception)
    assert "did you mean" in str(mwd(*words, "--code", "MWD+SRGN").exception)
    with SurveyStore(folder / "bare") as store:
        store.save(example.surveys(dataclasses.replace(example.WELL, error_model="")))
    assert "no error model is configured" in str(mwd(folder / "bare", *words[1:]).exception)
