# SPDX-License-Identifier: Apache-2.0
"""Every export: the numbers in all of them agree, and a file is whole or not there."""

import csv
import dataclasses
import io
import math
import os

import example_surveys as example
import lasio
import pytest
from hypothesis import example as case
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.exports.export import FORMATS, ExportError, export_file
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.page.state_json import path_table, quality_lights, survey_row
from mwd_surface.trajectory.plan import plan_of

W = "{http://www.witsml.org/schemas/1series}"
DEG = 180.0 / math.pi
PLAN = plan_of([0.0, 300.0, 900.0], [0.0, 0.0, 1.0], [0.0, 1.3, 1.3])


@pytest.fixture(scope="module")
def table():
    return example.table(plan=PLAN)


@pytest.fixture(scope="module")
def files(table, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    return table, {kind: export_file(table, kind, folder) for kind in FORMATS}


# Of each number: name in CSV, LAS, WITSML and on the page, title in the reports, factor of the page to people's units.
AGREE = (
    ("md_m", "DEPT", "md", "measured_depth", "MD", 1.0),
    ("inclination_deg", "INC", "incl", "inclination", "Inc", DEG),
    ("azimuth_deg", "AZI", "azi", "azimuth", "Azi", DEG),
    ("tvd_m", "TVD", "tvd", "vertical_depth", "TVD", 1.0),
    ("north_m", "NS", "dispNs", "north", "N/S", 1.0),
    ("east_m", "EW", "dispEw", "east", "E/W", 1.0),
    ("vertical_section_m", "VS", "vertSect", "vertical_section", "VS", 1.0),
    ("dls_deg_per_30m", "DLS", "dls", "dogleg_severity", "DLS", 30.0 * DEG),
    ("build_deg_per_30m", "BUILD", "rateBuild", "build_rate", "Build", 30.0 * DEG),
    ("turn_deg_per_30m", "TURN", "rateTurn", "turn_rate", "Turn", 30.0 * DEG),
)
SIGMAS = (
    ("sigma_north_m", "SIGN", "varianceNN", "1σ N"),
    ("sigma_east_m", "SIGE", "varianceEE", "1σ E"),
    ("sigma_vertical_m", "SIGV", "varianceVertVert", "1σ V"),
)


def read_csv(path):
    lines = [x for x in path.read_text(encoding="utf-8").splitlines() if not x.startswith("#")]
    return list(csv.DictReader(io.StringIO("\n".join(lines))))


def read_html(path, heading):
    """Lines of a table of the HTML report as (title, text) pairs by its heading."""
    page = etree.HTML(path.read_text(encoding="utf-8"))
    head = next(h for h in page.iter("h2", "h3") if h.text == heading)
    table = next(one for one in head.itersiblings() if one.tag == "div").find("table")
    titles = [th.text.strip() for th in table.iter("th")]
    return [list(zip(titles, ("".join(td.itertext()) for td in tr), strict=True)) for tr in table.findall("tbody/tr")]


def same(printed, exact, decimals):
    """A printed number is the other one, rounded once to its own decimals."""
    return abs(float(printed) - exact) <= 0.5 * 10.0**-decimals * 1.0001


@pytest.mark.slow
def test_every_number_of_the_path_agrees_in_all_exports_and_on_the_page(files):
    """CSV, LAS and WITSML to the last digit; the reports and the page within the decimals that are printed."""
    table, paths = files
    rows, las = read_csv(paths["csv"]), lasio.read(paths["las"], encoding="utf-8")
    stations = list(etree.parse(paths["witsml"]).getroot().iter(f"{W}trajectoryStation"))
    report = read_html(paths["html"], "Definitive survey")
    assert len(rows) == len(las["DEPT"]) == len(stations) == len(report) == len(table.records) == 13
    page = {r.survey.sequence: survey_row(r, table.surveys.north) for r in table.surveys.records}
    drawn = path_table(table.path, table.path.section_azimuth, table.covariance, 1000)
    for k, (row, station, cells) in enumerate(zip(rows, stations, report, strict=True)):
        printed = dict(cells)
        for key, mnemonic, tag, name, title, factor in AGREE:
            decimals, shown = table.column(key).listed.decimals, table.column(key).listed.shown
            assert float(row[key]) == las[mnemonic][k], (key, k)
            assert row[key] == station.findtext(W + tag), (key, k)
            exact = []
            if row["sequence"]:
                exact.append(page[int(row["sequence"])][name])
            if name in drawn:
                exact.append(drawn[name][k])
            for value in exact:
                assert same(row[key], value * factor, decimals), (key, k)
                assert same(printed[title], value * factor, shown), (key, k)
        for key, mnemonic, tag, title in SIGMAS:
            if not row[key]:
                assert printed[title] == ""
                continue
            assert float(row[key]) == las[mnemonic][k]
            variance = float(station.find(f"{W}matrixCov").findtext(W + tag))
            assert math.sqrt(variance) == pytest.approx(float(row[key]), abs=1.1e-3)
            assert same(printed[title], float(row[key]), 2) or float(printed[title]) == pytest.approx(
                float(row[key]), abs=0.0056
            )


@pytest.mark.slow
def test_verdicts_and_quality_agree_in_all_exports_and_on_the_page(files):
    table, paths = files
    raw = {row["sequence"]: row for row in read_csv(paths["raw_csv"])}
    las = lasio.read(paths["las"], encoding="utf-8")
    quality = [dict(cells) for cells in read_html(paths["html"], "Quality control of every survey taken")]
    judged = [dict(cells) for cells in read_html(paths["html"], "Totals as read, as judged, and their references")]
    stations = list(etree.parse(paths["witsml"]).getroot().iter(f"{W}trajectoryStation"))
    for line, totals_line in zip(quality, judged, strict=True):
        row = raw[line["Survey"]]
        record = table.surveys.find(int(line["Survey"]))
        shown = survey_row(record, table.surveys.north)
        words = [line["Inc is"], line["Azi is"], line["Toolface is"]]
        names = ("verdict_inclination", "verdict_azimuth", "verdict_toolface")
        assert words == shown["verdicts"] == [row[name].replace("_", " ") for name in names]
        assert row["headline"] == shown["headline"]
        lights = {light["name"]: light for light in quality_lights(record)["lights"]}
        field, gravity, dip = lights["total field"], lights["total gravity"], lights["dip"]
        assert same(line["ΔB"], field["deviation"] * 1e9, 0)
        assert same(line["ΔG"], gravity["deviation"] / STANDARD_GRAVITY * 1e3, 2)
        assert same(line["ΔDip"], dip["deviation"] * DEG, 2)
        assert same(row["b_judged_nt"], field["value"] * 1e9, 1)
        assert same(row["dip_judged_deg"], dip["value"] * DEG, 4)
        assert same(totals_line["B judged"], field["value"] * 1e9, 0)
        assert same(row["b_limit_nt"], field["limit"] * 1e9, 1)
        if record.in_use:
            k = table.path.sequence.index(record.survey.sequence)
            assert [int(las[name][k]) for name in ("VINC", "VAZI", "VTF")] == [
                int(getattr(record.survey, name)) for name in names
            ]
            assert f"azimuth {words[1]}" in stations[k].findtext(f"{W}commonData/{W}comments")
            assert float(stations[k].find(f"{W}valid").findtext(f"{W}magTotalFieldCalc")) == float(row["b_total_nt"])


@pytest.mark.slow
def test_html_and_pdf_print_the_same_cells(files):
    import pypdf

    _, paths = files
    page = etree.HTML(paths["html"].read_text(encoding="utf-8"))
    text = "".join("".join(p.extract_text() for p in pypdf.PdfReader(paths["pdf"]).pages).split())
    for table in page.iter("table"):
        for tr in table.findall("tbody/tr"):
            # A long text is broken over lines, between which the cells beside it stand.
            cells = ["".join(td.itertext()) for td in tr.findall("td")]
            short = "".join("".join(cells[: next((k for k, c in enumerate(cells) if len(c) > 18), None)]).split())
            assert short in text, cells


@pytest.mark.slow
def test_raw_and_definitive_agree_on_what_was_measured(files):
    _, paths = files
    raw = {row["sequence"]: row for row in read_csv(paths["raw_csv"])}
    for row in read_csv(paths["csv"]):
        if row["sequence"]:
            for name in ("md_m", "inclination_deg", "time_utc", "verdict_azimuth", "headline"):
                assert row[name] == raw[row["sequence"]][name]


@pytest.mark.slow
def test_names_are_made_of_well_word_and_time_or_of_what_is_asked(files, tmp_path):
    table, paths = files
    assert {p.name for p in paths.values()} >= {
        "Ω-1_ST0-definitive-20260515T174340Z.csv",
        "Ω-1_ST0-raw-20260515T174340Z.csv",
        "Ω-1_ST0-definitive-20260515T174340Z.las",
        "Ω-1_ST0-trajectory-20260515T174340Z.xml",
        "Ω-1_ST0-report-20260515T174340Z.html",
        "Ω-1_ST0-report-20260515T174340Z.pdf",
    }
    assert export_file(table, "csv", tmp_path, "x y.csv") == tmp_path / "x_y.csv"
    long = survey_table(example.surveys(dataclasses.replace(example.WELL, wellbore="W" * 300)), example.MADE)
    assert export_file(long, "csv", tmp_path).name.endswith("-definitive-20260515T174340Z.csv")


@pytest.mark.fault_case(80)
@given(st.text(max_size=12), st.sampled_from(["/", "\\", "\0"]), st.text(max_size=12))
@case("..", "/", "x")
@case("", "/", "etc/x")
@case("C:", "\\", "x")
def test_a_path_instead_of_a_name_is_refused_and_nothing_is_written(table, tmp_path_factory, before, mark, behind):
    folder = tmp_path_factory.mktemp("exports")
    with pytest.raises(ValueError, match="without folders"):
        export_file(table, "csv", folder, before + mark + behind)
    assert not any(folder.iterdir())


@pytest.mark.fault_case(80)
def test_a_link_that_lies_in_the_folder_is_replaced_and_what_it_leads_to_kept(table, tmp_path):
    outside, folder = tmp_path / "outside.csv", tmp_path / "exports"
    folder.mkdir()
    outside.write_text("kept")
    (folder / "x.csv").symlink_to(outside)
    path = export_file(table, "csv", folder, "x")
    assert outside.read_text() == "kept"
    assert not path.is_symlink()


def test_an_unknown_format_is_answered_with_the_near_ones(table, tmp_path):
    with pytest.raises(ValueError, match="unknown format 'wits'; did you mean witsml"):
        export_file(table, "wits", tmp_path)


def test_a_disk_that_refuses_leaves_the_old_file_and_no_piece_of_the_new(table, tmp_path, monkeypatch):
    path = export_file(table, "csv", tmp_path, "a")
    before = path.read_bytes()

    def full(_handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ExportError, match="could not be written: No space left"):
        export_file(table, "csv", tmp_path, "a")
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_two_formats_with_one_ending_and_one_name_are_two_files(table, tmp_path):
    assert export_file(table, "csv", tmp_path, "run7").name == "run7.csv"
    assert export_file(table, "raw_csv", tmp_path, "run7").name == "run7-raw.csv"
    assert export_file(table, "raw_csv", tmp_path, "all.csv").name == "all.csv"
