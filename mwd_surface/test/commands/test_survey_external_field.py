# SPDX-License-Identifier: Apache-2.0
"""`mwd survey` in a magnetic storm: the reference of each row is that of its time, whoever gives it."""

import csv
import datetime

import numpy as np
import pytest
import typer

from invoked_command import invoke
from mwd_sensors.core.frames import mat_nt
from mwd_surface.commands.survey import survey

APP = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
APP.command()(survey)
BEGIN = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)
STORM_NT = np.array([-150.0, 700.0, 90.0])
# Strength nT, dip and declination deg.
TOTAL, DIP, DECLINATION = 50000.0, 70.0, 2.0
TRUE_DEG = 110.0


@pytest.fixture
def observatory(tmp_path):
    """A day of minutes, in a storm for its last eight hours."""
    rng = np.random.default_rng(8)
    lines = [" Format                 IAGA-2002        |", "DATE       TIME         DOY     TSTX      TSTY      TSTZ |"]
    for k in range(1440):
        at = BEGIN + datetime.timedelta(minutes=k)
        values = [17000.0, 600.0, 47000.0] + rng.normal(0.0, 0.5, 3) + (STORM_NT if k >= 960 else 0.0)
        lines.append(f"{at:%Y-%m-%d %H:%M:%S}.000 {at:%j}   " + "".join(f"{value:10.2f}" for value in values))
    path = tmp_path / "tst20260301.min"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def table(tmp_path):
    """A row on a quiet morning, one in the storm and one of the day after."""
    dip, declination = np.radians(DIP), np.radians(DECLINATION)
    quiet = TOTAL * np.array([np.cos(dip) * np.cos(declination), np.cos(dip) * np.sin(declination), np.sin(dip)])
    rows = []
    for k, (hour, toolface) in enumerate([(6, 0.3), (18, 2.0), (30, 4.0)]):
        mat = mat_nt(np.radians(45.0), np.radians(TRUE_DEG), toolface)
        force, field = mat.T @ [0.0, 0.0, -9.81], mat.T @ (quiet + (STORM_NT if hour >= 16 else 0.0))
        rows.append([1000 + 30 * k, BEGIN + datetime.timedelta(hours=hour), *force, *field, TOTAL, DIP, DECLINATION])
    path = tmp_path / "table.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        sensors = [f"{name}_{axis}" for name in ("accel", "mag") for axis in ("axial", "tran1", "tran2")]
        writer.writerow(["md_m", "time", *sensors, "b_ref_nT", "dip_ref_deg", "decl_deg"])
        writer.writerows(rows)
    return path


def _rows(table, out, *words):
    done = invoke(APP, table, "-o", out, *words)
    return list(csv.DictReader(out.read_text().splitlines())), done.stdout


@pytest.mark.parametrize("words", [(), ("--field", f"{TOTAL},{DIP},{DECLINATION}")])
def test_each_row_is_corrected_by_the_field_of_its_time(table, observatory, tmp_path, words):
    # Each row by itself: a run would share what the row without external field shows.
    words = ("--single", *words)
    plain, _ = _rows(table, tmp_path / "plain.csv", *words)
    rows, _ = _rows(table, tmp_path / "out.csv", *words, "--set", f"place.observatory_file={observatory}")
    before, after = ([float(row["azimuth_deg"]) - TRUE_DEG for row in some] for some in (plain, rows))
    assert abs(before[1]) > 1.0
    assert abs(after[0]) < 0.05
    assert abs(after[1]) < 0.05
    # The file ends at midnight: the last row has no external field and says so.
    assert after[2] == pytest.approx(before[2], abs=1e-6)
    storm = "magnetic storm: the field at observatory TST was 72"
    assert [storm in row["reasons"] for row in rows] == [False, True, False]
    assert ["external field unknown" in row["reasons"] for row in rows] == [False, False, True]


@pytest.mark.slow
def test_a_tool_code_gives_the_sigmas_of_the_reference(table, tmp_path):
    wide, _ = _rows(table, tmp_path / "wide.csv", "--set", "survey.tool_code=MWD+SRGM")
    narrow, _ = _rows(table, tmp_path / "narrow.csv", "--set", "survey.tool_code=MWD+IFR2+SAG")
    assert float(narrow[0]["sigma_azimuth_deg"]) < 0.9 * float(wide[0]["sigma_azimuth_deg"])
