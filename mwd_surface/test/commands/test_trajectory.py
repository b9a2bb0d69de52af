# SPDX-License-Identifier: Apache-2.0
"""`mwd trajectory` as people call it: files with the differences, and one sentence for what is not there."""

import csv

import example_surveys as example
import lasio
import pytest
import typer

from invoked_command import invoke
from mwd_surface.commands.trajectory import trajectory
from mwd_surface.exports.report_content import content
from mwd_surface.surveys.survey_store import encoded
from mwd_surface.trajectory.slide_sheet import append_stretch

APP = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
APP.command()(trajectory)


def run(*words):
    return invoke(APP, *words).stdout


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "surveys.json").write_bytes(encoded(example.surveys()))
    return tmp_path


def test_the_slide_sheet_beside_the_list_is_used_and_the_files_agree(folder, tmp_path):
    for stretch in example.stretches():
        append_stretch(folder / "slides.jsonl", stretch)
    text = run(folder, "-o", tmp_path / "dense")
    assert "% slide sheet" in text
    rows = list(csv.DictReader((tmp_path / "dense" / "trajectory.csv").read_text().splitlines()))
    las = lasio.read(tmp_path / "dense" / "trajectory.las")
    assert las["TVD"] == pytest.approx([float(row["tvd_m"]) for row in rows])
    assert las["DTVD"] == pytest.approx([float(row["tvd_minus_minimum_curvature_m"]) for row in rows])
    assert {row["source"] for row in rows} == {"station", "slide sheet", "arc"}
    assert {row["azimuth_reference"] for row in rows} == {"grid"}
    assert (tmp_path / "dense" / "trajectory.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_table_of_continuous_data_is_used_before_the_slide_sheet(folder, tmp_path):
    path = example.surveys().definitive()
    table = tmp_path / "continuous.csv"
    lines = ["md_m,inc_deg,azi_deg"]
    for k in range(3600):
        md = 300.0 + 0.1 * k
        inclination, azimuth, _ = path.at(min(md, float(path.md[-1])))
        lines.append(f"{md:.1f},{inclination * 57.29577951:.4f},{azimuth * 57.29577951:.4f}")
    table.write_text("\n".join(lines) + "\n")
    assert "% continuous" in run(folder, "-o", tmp_path / "dense", "--continuous", table)


def test_what_is_missing_is_named(folder, tmp_path):
    with pytest.raises(ValueError, match="no slide sheet"):
        run(folder, "-o", tmp_path / "dense")
    with pytest.raises(ValueError, match="file not found"):
        run(folder, "-o", tmp_path / "dense", "--slides", tmp_path / "none.jsonl")
    with pytest.raises(ValueError, match="not a folder of `mwd process`"):
        run(folder, "-o", tmp_path / "dense", "--recording", tmp_path)


def test_the_report_shows_it_beside_the_definitive_survey():
    table = example.table(stretches=example.stretches())
    found = [one for one in content(table).sections if one.heading == "High-density trajectory"]
    assert len(found) == 1
    assert "not the definitive survey" in found[0].text[0]
