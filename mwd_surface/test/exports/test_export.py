"""Every export: the numbers in all of them agree, and a file is whole or not there."""

import csv
import dataclasses
import io
import os

import example_surveys as example
import lasio
import pytest
from lxml import etree

from mwd_surface.exports.export import FORMATS, ExportError, export
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.surveys.plan import plan_of

W = "{http://www.witsml.org/schemas/1series}"
PLAN = plan_of([0.0, 300.0, 900.0], [0.0, 0.0, 1.0], [0.0, 1.3, 1.3])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    table = example.table(plan=PLAN)
    return table, {kind: export(table, kind, folder) for kind in FORMATS}


def test_numbers_in_every_export_agree_to_printed_rounding(files):
    """CSV, LAS and WITSML to the last digit; HTML and PDF to the two decimals they print; and all with the list."""
    table, paths = files
    lines = [x for x in paths["csv"].read_text(encoding="utf-8").splitlines() if not x.startswith("#")]
    rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
    las = lasio.read(paths["las"], encoding="utf-8")
    stations = list(etree.parse(paths["witsml"]).getroot().iter(f"{W}trajectoryStation"))
    page = etree.HTML(paths["html"].read_text(encoding="utf-8"))
    printed = [
        [("".join(td.itertext())) for td in tr.findall("td")] for tr in page.find(".//table").findall("tbody/tr")
    ]
    assert len(rows) == len(las["DEPT"]) == len(stations) == len(printed) == 13
    columns = (
        ("md_m", "DEPT", "md", 1),
        ("inclination_deg", "INC", "incl", 2),
        ("azimuth_deg", "AZI", "azi", 3),
        ("tvd_m", "TVD", "tvd", 4),
        ("north_m", "NS", "dispNs", 5),
        ("east_m", "EW", "dispEw", 6),
        ("vertical_section_m", "VS", "vertSect", 7),
        ("dls_deg_per_30m", "DLS", "dls", 8),
        ("build_deg_per_30m", "BUILD", "rateBuild", 9),
        ("turn_deg_per_30m", "TURN", "rateTurn", 10),
    )
    for key, mnemonic, tag, place in columns:
        for k, row in enumerate(rows):
            assert float(row[key]) == las[mnemonic][k], (key, k)
            assert row[key] == stations[k].findtext(W + tag), (key, k)
            # Rounded once from the same value: at most half a last digit of both apart.
            assert float(printed[k][place]) == pytest.approx(float(row[key]), abs=0.00505 + 5e-4), (key, k)
    for key, mnemonic, place in (("sigma_east_m", "SIGE", 12), ("above_plan_m", "ABOVE", 15)):
        for k, row in enumerate(rows):
            if not row[key]:
                assert printed[k][place] == ""
                continue
            assert float(row[key]) == las[mnemonic][k]
            assert float(printed[k][place]) == pytest.approx(float(row[key]), abs=0.0056)
    for record, row in zip(table.records, rows, strict=True):
        if record is not None:
            assert float(row["north_m"]) == pytest.approx(record.north, abs=5.1e-4)
            assert float(row["tvd_m"]) == pytest.approx(record.vertical_depth, abs=5.1e-4)


def test_html_and_pdf_print_the_same_cells(files):
    pypdf = pytest.importorskip("pypdf", reason="pypdf, the reader, is not installed")
    _, paths = files
    page = etree.HTML(paths["html"].read_text(encoding="utf-8"))
    text = " ".join(" ".join(p.extract_text() for p in pypdf.PdfReader(paths["pdf"]).pages).split())
    for tr in page.find(".//table").findall("tbody/tr"):
        cells = ["".join(td.itertext()) for td in tr.findall("td")][:-1]
        assert " ".join(c for c in cells if c) in text


def test_raw_and_definitive_agree_on_what_was_measured(files):
    _, paths = files
    read = []
    for kind in ("csv", "raw_csv"):
        lines = paths[kind].read_text(encoding="utf-8").splitlines()
        read.append({r["survey"]: r for r in csv.DictReader(x for x in lines if not x.startswith("#"))})
    for number, row in read[0].items():
        if number:
            raw = read[1][number]
            assert (row["md_m"], row["inclination_deg"], row["time_utc"]) == (
                raw["md_m"],
                raw["inclination_deg"],
                raw["time_utc"],
            )


def test_names_are_made_of_well_word_and_time_or_of_what_is_asked(files, tmp_path):
    table, paths = files
    assert {p.name for p in paths.values()} >= {
        "1_ST0-definitive-20260515T174340Z.csv",
        "1_ST0-raw-20260515T174340Z.csv",
        "1_ST0-definitive-20260515T174340Z.las",
        "1_ST0-trajectory-20260515T174340Z.xml",
        "1_ST0-report-20260515T174340Z.html",
        "1_ST0-report-20260515T174340Z.pdf",
    }
    assert export(table, "csv", tmp_path, "../../x.csv") == tmp_path / "x.csv"
    long = survey_table(example.surveys(dataclasses.replace(example.WELL, wellbore="W" * 300)), example.MADE)
    assert export(long, "csv", tmp_path).name.endswith("-definitive-20260515T174340Z.csv")


def test_an_unknown_format_is_answered_with_the_near_ones(files, tmp_path):
    with pytest.raises(ValueError, match="no 'wits'; did you mean witsml"):
        export(files[0], "wits", tmp_path)


def test_a_disk_that_refuses_leaves_the_old_file_and_no_piece_of_the_new(files, tmp_path, monkeypatch):
    path = export(files[0], "csv", tmp_path, "a")
    before = path.read_bytes()

    def full(_handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ExportError, match="not written: No space left"):
        export(files[0], "csv", tmp_path, "a")
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]
