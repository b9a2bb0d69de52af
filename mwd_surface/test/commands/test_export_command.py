# SPDX-License-Identifier: Apache-2.0
"""`mwd export` and `mwd report`: the files are those of the export kernel, from a folder and from a recording alike."""

import dataclasses
import json

import example_surveys as example
import pytest
from plotted_bag import recorded
from test_cli import mwd, refused

from mwd_surface.exports.csv_tables import definitive_csv
from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.surveys.survey_store import SurveyStore
from mwd_surface.trajectory.plan import plan_of


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    with SurveyStore(folder / "w1" / "surveys") as store:
        store.save(example.surveys())
    return folder


def numbers(text):
    return [line for line in text.splitlines() if not line.startswith("#")]


@pytest.mark.slow
def test_every_format_is_written_and_says_where(run, tmp_path):
    for kind, made in FORMATS.items():
        # The reports are written by `mwd report` below.
        if kind in ("html", "pdf"):
            continue
        done = mwd("export", run, "-f", kind, "-o", tmp_path / f"one{made.ending}")
        assert done.returncode == 0, done.stderr
        assert done.stdout == f"written: {tmp_path / f'one{made.ending}'}\n"
        assert (tmp_path / f"one{made.ending}").read_bytes().strip()


def test_the_numbers_are_those_of_the_export_kernel(run, tmp_path):
    plan = plan_of([0.0, 300.0, 900.0], [0.0, 0.0, 1.0], [0.0, 1.3, 1.3])
    (tmp_path / "plan.csv").write_text("md_m,inc_rad,azi_rad\n0,0,0\n300,0,1.3\n900,1,1.3\n")
    out = tmp_path / "s.csv"
    assert mwd("export", run, "-o", out, "--plan", tmp_path / "plan.csv", "--bit-depth", 700).returncode == 0
    table = survey_table(example.surveys().along(plan), example.MADE, bit_depth=700.0)
    assert numbers(out.read_text(encoding="utf-8")) == numbers(definitive_csv(table))


def test_a_recording_with_the_well_given_gives_the_same_numbers(run, tmp_path):
    bag = recorded(tmp_path / "bag", [example.surveys()])
    given = []
    for field in dataclasses.fields(example.WELL):
        value = getattr(example.WELL, field.name)
        if field.default is not dataclasses.MISSING and value != field.default:
            given += ["--set", f"well.{field.name}={json.dumps(value)}"]
    done = mwd("export", bag, "-o", tmp_path / "bag.csv", *given)
    assert done.returncode == 0, done.stderr
    assert "description of the well" in done.stderr
    assert mwd("export", run, "-o", tmp_path / "run.csv").returncode == 0
    assert numbers((tmp_path / "bag.csv").read_text()) == numbers((tmp_path / "run.csv").read_text())


@pytest.mark.slow
def test_a_report_is_html_and_pdf(run, tmp_path):
    done = mwd("report", run, "-o", tmp_path / "reports")
    assert done.returncode == 0, done.stderr
    html, pdf = sorted((tmp_path / "reports").iterdir())
    assert html.suffix == ".html"
    assert pdf.read_bytes().startswith(b"%PDF")


@pytest.mark.slow
def test_what_is_wrong_is_one_sentence(run, tmp_path):
    refused(mwd("export", tmp_path / "none"), "there is nothing at")
    refused(mwd("export", run, "-f", "wits", "-o", tmp_path), "did you mean witsml")
    refused(mwd("export", run, "-f", "las", "-o", tmp_path / "a.csv"), "las is written as .las")
    refused(mwd("export", run, "--set", "rules.gap_limit=3", "-o", tmp_path), "only well.*")
    refused(mwd("export", run, "--leg", "st9", "-o", tmp_path), "there is no 'st9'")
    (tmp_path / "plan.csv").write_text("md_m,inc,azi\n0,0,0\n30,x,0\n")
    refused(mwd("report", run, "-o", tmp_path, "--plan", tmp_path / "plan.csv"), "line 3", "finite number")
    (tmp_path / "file").write_text("")
    refused(mwd("export", run, "-o", tmp_path / "file" / "folder"), "could not be written")
