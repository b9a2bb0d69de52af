# SPDX-License-Identifier: Apache-2.0
"""Six-axis tables: the Volve stations against their published survey, other people's column names, and refusals."""

import csv
import math

import numpy as np
import openpyxl
import pytest

from mwd_estimation.core.reason_text import texts
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_estimation.survey.station import StationSettings
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_surface.list_files.six_axis_table import find_columns, read_readings, single_stations, table_rows
from project import REFERENCE_DATA

DEG = math.pi / 180.0
VOLVE = REFERENCE_DATA / "volve" / "volve_F5_raw_sixaxis.csv"


def stations(table, override=None, settings=None, **options):
    return single_stations(table_rows(table, override, **options), settings)


def volve():
    with VOLVE.open() as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


@pytest.mark.parametrize("limits", ["service", "iscwsa", "toolcode"])
def test_volve_stations_are_reproduced_and_judged_as_published(limits):
    table = volve()
    done = stations(table, settings=StationSettings(quality=QualitySettings(limits=limits)))
    assert [row.station.verdict for row in done] == ["reject", "reject", "accept"]
    for k, row in enumerate(done):
        shot = row.station
        published = [float(table[name][k]) for name in ("incl_deg", "b_total_calc_nT", "dip_calc_deg", "g_total_calc")]
        assert [
            math.degrees(shot.inclination),
            shot.b_total * 1e9,
            math.degrees(shot.dip),
            shot.g_total,
        ] == pytest.approx(published, abs=0.006, rel=1e-6)
        # Near vertical the axes' own resolution is 0.05 deg of azimuth and more.
        tolerance = 0.006 if shot.inclination > 0.1 else 0.1
        raw, published_azimuth = shot.by_method("raw"), float(table["azi_grid_deg"][k])
        assert math.degrees(raw.azimuth) == pytest.approx(published_azimuth, abs=tolerance)
        assert abs(wrap_pi(shot.azimuth - math.radians(published_azimuth))) < shot.sigma_azimuth
        assert shot.north == "grid"
        assert shot.reasons
        assert row.md == float(table["md_m"][k])
        assert row.time == table["dtim_utc"][k]
    assert any("dip +6.38 deg" in reason for reason in texts(done[0].station.reasons))
    assert any("dip +4.76 deg" in reason for reason in texts(done[1].station.reasons))
    assert texts(done[2].station.reasons)[-1].startswith("within limits")


def test_volve_toolfaces_follow_with_the_offset_of_their_run():
    table = volve()
    for k, offset in enumerate((89.95, 89.95, 29.0)):
        # The published zero of the sensor housing is its low side.
        settings = StationSettings(toolface_offset_deg=offset - 180.0)
        shot = stations(table, settings=settings)[k].station
        gap = math.degrees(shot.gravity_toolface) - float(table["gtf_deg"][k])
        assert (gap + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.05)


def shots(n=3):
    inc, azi, toolface = np.linspace(20, 60, n) * DEG, np.linspace(40, 80, n) * DEG, np.linspace(0, 200, n) * DEG
    mat_tn = np.swapaxes(mat_nt(inc, azi, toolface), -1, -2)
    return mat_tn @ np.array([0, 0, 9.81]), mat_tn @ np.array([16e-6, 0, 47e-6]), inc, azi


@pytest.mark.parametrize(
    ("names", "g_factor", "b_factor", "order", "options"),
    [
        (["Gx (g)", "Gy (g)", "Gz (g)", "Bx (nT)", "By (nT)", "Bz (nT)"], 1 / 9.80665, 1e9, (1, 2, 0), {"axial": "z"}),
        (["gx", "gy", "gz", "bx", "by", "bz"], 1000 / 9.80665, 1e6, (0, 1, 2), {"axial": "x"}),
        (["accel_x", "accel_y", "accel_z", "mag_x_ut", "mag_y_ut", "mag_z_ut"], -1, 1e6, (0, 1, 2), {"axial": "x"}),
        (["Grav Axial", "Grav Tran1", "Grav Tran2", "MAG_AXIAL", "MAG_TRAN1", "MAG_TRAN2"], 1, 1e4, (0, 1, 2), {}),
    ],
)
def test_other_names_units_and_axis_letters_give_the_same_survey(names, g_factor, b_factor, order, options):
    g_t, b_t, inc, azi = shots()
    columns = [g_t[:, k] * g_factor for k in order] + [b_t[:, k] * b_factor for k in order]
    done = stations(dict(zip(names, columns, strict=True)), **options)
    assert [row.station.inclination for row in done] == pytest.approx(list(inc))
    assert [row.station.azimuth for row in done] == pytest.approx(list(azi))
    assert done[0].station.north == "magnetic"
    assert math.isnan(done[0].md)


def plain_table(**more):
    g_t, b_t, _, _ = shots()
    table = {f"grav_{axis}_mps2": g_t[:, k] for k, axis in enumerate(("axial", "tran1", "tran2"))}
    table |= {f"mag_{axis}_nT": b_t[:, k] * 1e9 for k, axis in enumerate(("axial", "tran1", "tran2"))}
    return table | more


def test_a_reference_given_by_hand_comes_before_the_rows_own():
    table = plain_table(b_ref_nT=["49649"] * 3, dip_ref_deg=["71.2"] * 3, declination_deg=["2"] * 3)
    own = stations(table)[0].station
    assert (own.reference.source, own.north) == ("table", "true")
    given = stations(table, Reference(50e-6, 71 * DEG, source="by hand", convergence=1 * DEG))[0].station
    assert given.reference.total == 50e-6
    assert given.reference.declination == pytest.approx(2 * DEG)
    assert (given.north, given.reference.source) == ("grid", "by hand")


def test_depths_in_feet_come_out_in_metres_and_unit_guesses_are_reported():
    table = plain_table(
        MD_ft=[1000.0, 1100.0, 1200.0], comment=["a", "b", "c"], dip_ref=[71.0] * 3, b_ref=[49650.0] * 3
    )
    assert stations(table)[0].md == pytest.approx(304.8)
    columns = find_columns(table)
    assert columns.assumed == ("b_ref: read as nT", "dip_ref: read as deg")


def test_a_row_that_cannot_be_read_is_rejected_and_not_left_out():
    table = plain_table()
    table["mag_tran1_nT"] = ["1000", "", "abc"]
    table["grav_axial_mps2"] = ["9.0", "8.0", None]
    done = stations(table)
    assert len(done) == 3
    assert [row.station.verdict for row in done[1:]] == ["reject", "reject"]
    assert "no number in mag_tran1_nT" in texts(done[1].station.reasons)
    assert any("grav_axial_mps2" in reason for reason in texts(done[2].station.reasons))
    assert math.degrees(done[1].station.inclination) > 0.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.pop("mag_tran2_nT"), "magnetic field: no column mag_tran2_nt"),
        (lambda t: t.update(grav_trn2_mps2=t.pop("grav_tran2_mps2")), "is it grav_trn2_mps2"),
        (lambda t: t.update(gravity_axial_mps2=t["grav_axial_mps2"]), "given twice"),
        (lambda t: t.update(mag_tran2=t.pop("mag_tran2_nT")), "all three axes a unit, or none"),
        (lambda t: t.update(b_ref_nT=[50000.0] * 3), "row 1: reference total is given without dip"),
        (lambda t: t.update(mag_tran2_nT=[1.0]), "1 values where"),
    ],
)
def test_a_table_that_cannot_be_understood_is_refused_with_a_hint(change, words):
    table = plain_table()
    change(table)
    with pytest.raises(ValueError, match=words):
        stations(table)


def test_letters_without_word_of_the_axis_are_refused_by_name():
    g_t, b_t, _, _ = shots()
    table = {f"g{c}": g_t[:, k] for k, c in enumerate("xyz")} | {f"b{c}": b_t[:, k] * 1e9 for k, c in enumerate("xyz")}
    with pytest.raises(ValueError, match="gx, gy, gz do not show which axis points down-hole"):
        stations(table)
    with pytest.raises(ValueError, match="not x or z"):
        stations(table, axial="y")


G_T, B_T, INC, _ = shots(6)
DEPTHS = 500.0 + 30.0 * np.arange(6)
ACROSS = ("Gx", "Gy", "Gz", "Bx", "By", "Bz")


def readings(acceleration=9.80665, field=1e-9, depth=1.0):
    """Rows of depth, and of readings with the axis z along the hole, in units of m, m/s^2 and T."""
    order = [1, 2, 0]
    return np.column_stack([DEPTHS / depth, G_T[:, order] / acceleration, B_T[:, order] / field]).tolist()


def lines(names, rows, separator=",", form="{:.6f}".format):
    return "\n".join([separator.join(names), *(separator.join(map(form, row)) for row in rows)]) + "\n"


def units(length, acceleration, field, names=ACROSS):
    sensors = [acceleration] * 3 + [field] * 3
    return [f"MD ({length})", *(f"{name} ({unit})" for name, unit in zip(names, sensors, strict=True))]


METRIC = units("m", "g", "nT")
MARKED = "Raw surveys\nWell: X,,,,,,\n\n"
PLAIN = lines(METRIC, readings())
FILES = {
    "titles": MARKED + PLAIN,
    "line of units": lines(["MD", *ACROSS], readings(9.80665e-3, 1e-9, 0.3048)).replace(
        "\n", "\nft,mg,mg,mg,nT,nT,nT\n", 1
    ),
    "decimal comma": lines(METRIC, readings(), ";", lambda v: f"{v:.6f}".replace(".", ",")),
    "thousands": lines(METRIC, readings(), ";", "{:,.5f}".format),
    "spaces": lines(["  MD ", *ACROSS], readings(), " ", "{:>13.5f}".format),
    "micro sign": lines(units("m", "g", "\u00b5T"), readings(field=1e-6)),
    "greek letter": lines(units("m", "g", "\u03bcT"), readings(field=1e-6)),
    "gauss": lines(units("m", "g", "G"), readings(field=1e-4)),
    "feet": lines(units("ftKB", "ft/s2", "nT"), readings(0.3048, depth=0.3048)),
    "seconds squared": lines(units("m", "m/sec\u00b2", "nT"), readings(1.0)),
    "order of words": lines(
        units("m", "g", "nT", [f"{c} {w}" for w in ("Gravity", "Magnetic") for c in "XYZ"]), readings()
    ),
    "other names of the depth": PLAIN.replace("MD (m)", "Meas. Depth (m)"),
    "depth of the bit beside": lines(["Bit Depth (m)", *METRIC], [[row[0] + 15.0, *row] for row in readings()]),
    "depth of the hole beside": lines(["Hole Depth (m)", *METRIC], [[row[0] + 15.0, *row] for row in readings()]),
    "units in the cells": PLAIN.replace("500.000000,", "500.0 m,"),
    "notes and totals": PLAIN.replace("590.0", "Bit trip,,,,,,\n590.0") + "Total,6,stations\n",
    "header again": PLAIN.replace("590.0", f"{','.join(METRIC)}\n590.0"),
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_the_same_readings_in_any_file_are_the_same_stations(tmp_path, name, encoding):
    path = tmp_path / "readings.txt"
    path.write_bytes(FILES[name].encode(encoding))
    assert_same(path)


def test_a_spreadsheet_with_titles_is_a_table_of_readings(tmp_path):
    book = openpyxl.Workbook()
    for row in (["Raw surveys"], [], METRIC, *readings()):
        book.active.append(row)
    book.save(tmp_path / "readings.xlsx")
    assert_same(tmp_path / "readings.xlsx")


def assert_same(path):
    table, _ = read_readings(path, "z")
    rows = table_rows(table, axial="z")
    np.testing.assert_allclose([row.md for row in rows], DEPTHS, atol=0.01)
    np.testing.assert_allclose([row.f_t for row in rows], -G_T, atol=2e-3)
    np.testing.assert_allclose([row.b_t for row in rows], B_T, atol=2e-9)


@pytest.mark.parametrize(
    "cells",
    [
        ["Date,Time", *(f"{day}/03/2026,06:30" for day in range(10, 16))],
        ["DateTime", *(f"{day}.03.2026 06:30:00" for day in range(10, 16))],
        ["Survey Time", *(f"{day}-Mar-26 06:30" for day in range(10, 16))],
    ],
)
def test_dates_of_any_kind_are_times_of_the_rows(tmp_path, cells):
    path = tmp_path / "readings.csv"
    path.write_text("\n".join(f"{a},{b}" for a, b in zip(cells, PLAIN.splitlines(), strict=True)))
    rows = table_rows(read_readings(path, "z")[0], axial="z")
    assert [row.time for row in rows] == [f"2026-03-{day}T06:30:00+00:00" for day in range(10, 16)]


def test_a_declination_to_the_west_is_negative_and_a_mistyped_one_is_refused():
    west = plain_table(b_ref_nT=[49649.0] * 3, **{"Reference Dip": ["71.2"] * 3, "Magnetic Declination": ["2.2 W"] * 3})
    assert stations(west)[0].station.reference.declination == pytest.approx(-2.2 * DEG)
    with pytest.raises(ValueError, match="'2;1' is not a number"):
        stations(west | {"Magnetic Declination": ["2;1"] * 3})


def test_a_table_without_a_known_depth_names_the_columns_that_are_not_used():
    (remark,) = find_columns(plain_table(**{"Bohrtiefe (m)": [1.0, 2.0, 3.0], "time": ["", "", ""]})).assumed
    assert "Bohrtiefe (m)" in remark
    assert not any(name in remark for name in ("time", "grav_axial", "mag_axial"))


def test_a_depth_without_a_unit_is_named():
    assert find_columns(plain_table(MD=[1.0, 2.0, 3.0])).assumed == ("MD: read as m",)
