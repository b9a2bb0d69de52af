# SPDX-License-Identifier: Apache-2.0
"""The same list in every dialect is the same stations, and every command that reads it has the same path."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from list_dialects import FEET, NAMES, UNIT_WORDS, Dialect, las, p7, spreadsheet, text, witsml

from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import list_of
from mwd_surface.list_files.remark import RemarkKind
from mwd_surface.surveys.imported_list import survey_list
from mwd_surface.trajectory.plan import plan_from_list

DIPS = [
    "Dip",
    "Pitch (deg)",
    "BH_Dip",
    "Drill Dip (°)",
    "Plunge",
    "倾角(°)",
    "钻孔倾角/°",
    "实测倾角",
    "俯仰角",
    "仰角(度)",
]


@st.composite
def lists(draw, least=3):
    """Stations of a hole that somebody drilled: steps of some metres, angles that turn by a few degrees."""
    count = draw(st.integers(least, 12))
    steps = draw(st.lists(st.floats(8.0, 60.0), min_size=count - 1, max_size=count - 1))
    start = draw(st.sampled_from([0.0, 0.0, 250.0, 1100.0]))
    md = np.round(start + np.concatenate([[0.0], np.cumsum(steps)]), 2)
    build = draw(st.lists(st.floats(-0.1, 0.2), min_size=count - 1, max_size=count - 1))
    first = 0.0 if start == 0.0 else draw(st.floats(0.0, 60.0))
    inc = np.clip(np.concatenate([[first], first + np.cumsum(np.array(build) * np.diff(md))]), 0.0, 170.0)
    azi = draw(st.floats(0.0, 359.0)) + np.concatenate([[0.0], np.cumsum(np.full(count - 1, 1.5))])
    return md, np.radians(np.round(inc, 2)), np.radians(np.round(azi, 2) % 360.0)


@st.composite
def dialects(draw):
    separator = draw(st.sampled_from([",", ";", "\t", "|", "  "]))
    decimal = draw(st.sampled_from([".", ","]))
    thousands = draw(st.sampled_from(["", " ", "\u00a0", "'", "." if decimal == "," else ","]))
    if separator == "  ":
        thousands = thousands if thousands in ("", "'", ".", ",") else ""
    unit = draw(st.sampled_from(list(FEET)))
    language = draw(st.sampled_from(list(NAMES)))
    plain = language != "chinese"
    encoding = draw(
        st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-32", *(["cp1252"] if plain else ["gb18030"])])
    )
    return Dialect(
        separator=separator,
        decimal=decimal,
        thousands=thousands,
        encoding=encoding,
        unit=unit,
        unit_word=draw(st.sampled_from(UNIT_WORDS[unit])),
        degree=draw(st.sampled_from(["deg", "°", "degrees"])),
        language=language,
        positions=draw(st.booleans()),
        empty_column=draw(st.booleans()) and separator != "  ",
        footer=draw(st.booleans()),
        page_break=draw(st.booleans()),
        head=draw(st.booleans()),
        newline=draw(st.sampled_from(["\n", "\r\n"])),
    )


def assert_same(read, stations, rounding=5e-5):
    md, inc, azi = stations
    np.testing.assert_allclose(read.md, md, atol=rounding)
    np.testing.assert_allclose(np.degrees(read.inclination), np.degrees(inc), atol=rounding)
    turned = np.degrees(read.azimuth) - np.degrees(azi)
    np.testing.assert_allclose((turned + 180.0) % 360.0 - 180.0, 0.0, atol=rounding)


@given(lists(), dialects())
def test_the_same_list_in_any_dialect_of_a_table_is_the_same_stations(stations, dialect):
    read = list_of(text(stations, dialect))
    assert_same(read, stations)
    assert read.north == ("grid" if dialect.head else "")


@given(lists(), st.sampled_from(list(FEET)))
def test_the_same_list_in_any_kind_of_file_is_the_same_stations(stations, unit):
    dialect = Dialect(unit=unit, unit_word=UNIT_WORDS[unit][0])
    for data in (
        spreadsheet(stations, dialect),
        las(stations, dialect),
        las(stations, dialect, 3),
        *(witsml(stations, dialect, version) for version in ("1.3.1.1", "1.4.1.1", "2.0", "2.1")),
        p7(stations, dialect),
    ):
        assert_same(list_of(data), stations)


@given(lists(), dialects(), st.sampled_from(["-999.25", "-999", "1e30", "N/A", "-", "null", "NaN", "-9999"]))
def test_a_null_value_is_no_value_in_any_spelling(stations, dialect, null):
    plain = Dialect(separator=dialect.separator if dialect.separator != "  " else ";", positions=True)
    lines = text(stations, plain).decode().splitlines()
    cells = lines[-1].split(plain.separator)
    assume(len(cells) == 6)
    lines[-1] = plain.separator.join([*cells[:2], null, *cells[3:]])
    read = list_of("\n".join(lines).encode())
    assert math.isnan(read.azimuth[-1])
    np.testing.assert_allclose(read.md, stations[0], atol=5e-5)
    assert RemarkKind.AZIMUTH_MISSING in {one.kind for one in read.remarks}
    lines[-1] = plain.separator.join([cells[0], null, *cells[2:]])
    short = list_of("\n".join(lines).encode())
    np.testing.assert_allclose(short.md, stations[0][:-1], atol=5e-5)
    assert RemarkKind.ROWS_LEFT_OUT in {one.kind for one in short.remarks}


@given(lists(), dialects())
def test_path_plan_and_offset_well_have_the_same_hole(stations, dialect):
    """Whoever reads a list, also one that begins at depth, has its path: they share one rule for the start."""
    read = list_of(text(stations, dialect))
    path, plan = survey_list(read).definitive(), plan_from_list(read)
    np.testing.assert_array_equal(plan.md, path.md)
    np.testing.assert_allclose(plan.positions, path.positions, atol=1e-9)
    assert plan.md[0] == 0.0


@given(lists(), st.sampled_from([("down", -1.0), ("up", 1.0)]), st.sampled_from(DIPS))
def test_angles_from_the_horizontal_become_inclinations_or_are_refused(stations, way, name):
    md, inc, azi = stations
    dips = way[1] * (np.degrees(inc) - 90.0)
    rows = "".join(f"{m:.2f},{d:.4f},{math.degrees(a):.4f}\n" for m, d, a in zip(md, dips, azi, strict=True))
    data = f"MD (m),{name},Azimuth\n{rows}".encode()
    with pytest.raises(ListFileError, match="from the horizontal"):
        list_of(data)
    assert_same(list_of(data, given=Given(dip=way[0])), stations)


@given(lists(least=4), st.floats(1e5, 8e6), st.floats(1e5, 9e5))
def test_map_coordinates_lose_the_wellhead_and_change_no_station(stations, northing, easting):
    assume(stations[0][0] == 0.0)
    dialect = Dialect(decimals=6)
    lines = text(stations, dialect).decode().splitlines()
    moved = [lines[0].replace("+N/-S", "Northing").replace("+E/-W", "Easting")]
    for line in lines[1:]:
        *rest, n, e = line.split(",")
        moved.append(",".join([*rest, f"{float(n) + northing:.6f}", f"{float(e) + easting:.6f}"]))
    read = list_of("\n".join(moved).encode())
    local = list_of("\n".join(lines).encode())
    np.testing.assert_allclose(read.positions, local.positions, atol=1e-5)
    (shifted,) = [one for one in read.remarks if one.kind == RemarkKind.MAP_SHIFTED]
    assert shifted.values["northing"] == pytest.approx(northing, abs=1e-5)
