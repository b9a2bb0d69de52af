# SPDX-License-Identifier: Apache-2.0
"""Kinds of files: Excel 2003 XML, HTML tables, WITSML in any unit; and what is not read is named exactly."""

import io
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from test_list_dialects import assert_same, lists

from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.list_files.exchange_formats import p7_table
from mwd_surface.list_files.list_columns import ENERGISTICS_UNITS, LENGTH_UNITS
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import list_of

TITLE = ("Definitive survey of well A-1",)
NORTH = ("North Reference:", "Grid")
NAMES = ("MD (ft)", "Incl (°)", "Azi (°)")


def rows_of(stations):
    md, inc, azi = stations
    return list(zip(md / 0.3048, np.degrees(inc), np.degrees(azi), strict=True))


def html(stations, *, one_line=False, wrapped=False):
    end = "" if one_line else "\n"
    head = [f"<tr><td colspan=3><b>{TITLE[0]}</b></td></tr>", f"<tr><td>{NORTH[0]}</td><td>{NORTH[1]}</td></tr>"]
    names = "<tr>" + "".join(f"<th>{name}</th>" for name in NAMES) + "</tr>"
    body = ["<tr>" + "".join(f"<td>{v:,.4f}</td>" for v in row) + "</tr>" for row in rows_of(stations)]
    table = f"<table>{end}{end.join([*head, names, *body])}{end}</table>"
    table = f"<table><tr><td>{table}</td></tr></table>" if wrapped else table
    return f"<html><head><title>x</title><style>td {{color:red}}</style></head><body>{table}</body></html>".encode()


def workbook(stations):
    def row(cells, index=""):
        typed = (("Number", repr(float(c))) if not isinstance(c, str) else ("String", c) for c in cells)
        data = [f'<Cell><Data ss:Type="{kind}">{text}</Data></Cell>' for kind, text in typed]
        if index and data:
            data[0] = data[0].replace("<Cell>", f'<Cell ss:Index="{index}">')
        return f"<Row>{''.join(data)}</Row>"

    body = "".join(row(one, "2") for one in (TITLE, NORTH, NAMES, *rows_of(stations)))
    return (
        '<?xml version="1.0"?><?mso-application progid="Excel.Sheet"?>'
        '<Workbook xmlns="urn:schemas-microsoft-com:office:spreadsheet"'
        ' xmlns:ss="urn:schemas-microsoft-com:office:spreadsheet">'
        '<Worksheet ss:Name="Notes"><Table><Row><Cell><Data ss:Type="String">none</Data></Cell></Row></Table>'
        "</Worksheet>"
        f'<Worksheet ss:Name="Survey"><Table>{body}</Table></Worksheet></Workbook>'
    ).encode()


def witsml(stations, uom, angle="dega"):
    factor = {**LENGTH_UNITS, **ENERGISTICS_UNITS}[uom]
    per = {"dega": math.pi / 180.0, "rad": 1.0, **ENERGISTICS_UNITS}[angle]
    body = "".join(
        f'<trajectoryStation><md uom="{uom}">{md / factor!r}</md><incl uom="{angle}">{inc / per!r}</incl>'
        f'<azi uom="{angle}">{azi / per!r}</azi></trajectoryStation>'
        for md, inc, azi in (map(float, one) for one in zip(*stations, strict=True))
    )
    return (
        '<trajectorys xmlns="http://www.witsml.org/schemas/1series" version="1.4.1.1"><trajectory><name>A</name>'
        f"<aziRef>grid north</aziRef>{body}</trajectory></trajectorys>"
    ).encode()


@given(lists(), st.booleans(), st.booleans())
def test_an_html_table_is_the_list_that_it_shows(stations, one_line, wrapped):
    read = list_of(html(stations, one_line=one_line, wrapped=wrapped), "survey.xls")
    assert_same(read, stations, 1e-4)
    assert read.north == "grid"


@given(lists())
def test_an_excel_2003_workbook_in_xml_is_the_list_that_it_shows(stations):
    read = list_of(workbook(stations), "survey.xls")
    assert_same(read, stations, 1e-6)
    assert read.north == "grid"


@given(
    lists(),
    st.sampled_from(["m", "km", "cm", "mm", "ft", "in", "yd", "dm", "mi", "ftUS", "ftCla", "ftSe", "ft[US]", "in[US]"]),
    st.sampled_from(["dega", "rad", "mrad", "mina", "rev"]),
)
def test_a_trajectory_is_the_same_in_any_unit_of_energistics(stations, uom, angle):
    assert_same(list_of(witsml(stations, uom, angle)), stations, 1e-6)


def test_a_unit_of_another_quantity_is_quoted():
    stations = np.array([0.0, 30.0]), np.array([0.0, 0.1]), np.array([0.0, 1.0])
    with pytest.raises(ListFileError, match="'mrad', which is not a known unit"):
        list_of(witsml(stations, "m").replace(b'uom="m"', b'uom="mrad"'))


def test_markup_on_one_long_line_is_read():
    md = np.arange(0.0, 30_000.0, 30.0)[:600]
    stations = md, np.full(md.size, 0.3), np.full(md.size, 1.0)
    assert len(witsml(stations, "m")) > 50_000
    assert_same(list_of(witsml(stations, "m")), stations)
    assert_same(list_of(html(stations, one_line=True)), stations, 1e-4)


@given(lists(), st.sampled_from(["km", "m", "ft", "usft"]))
def test_map_coordinates_have_a_unit_of_their_own(stations, unit):
    md, inc, azi = stations
    positions = mc.path(md, inc, azi, (0.0, 0.0, md[0]))
    factor = LENGTH_UNITS[unit]
    lines = [f"md_m,inc_deg,azi_grid_deg,tvd_m,Northing ({unit}),Easting ({unit})"]
    for row in zip(md, np.degrees(inc), np.degrees(azi), positions, strict=True):
        n, e = (6_478_300.0 + row[3][0]) / factor, (431_200.0 + row[3][1]) / factor
        lines.append(f"{row[0]:.2f},{row[1]:.4f},{row[2]:.4f},{row[3][2]:.3f},{n:.8f},{e:.8f}")
    head = "# Wellhead Northing: 6478300.0 (m)\n# Wellhead Easting: 431200.0 (m)\n"
    read = list_of((head + "\n".join(lines)).encode())
    np.testing.assert_allclose(read.positions, positions, atol=0.01)


def petrel(stations, depth_unit, head):
    """A Petrel trace: depths in one unit, coordinates in metres."""
    md, inc, azi = stations
    positions = mc.path(md, inc, azi, (0.0, 0.0, md[0]))
    per = LENGTH_UNITS[depth_unit]
    rows = [
        f"{m / per:.4f} {431_200.0 + p[1]:.4f} {6_478_300.0 + p[0]:.4f} {(25.0 - p[2]) / per:.4f} {p[2] / per:.4f}"
        f" {p[1]:.4f} {p[0]:.4f} {math.degrees(a):.4f} {math.degrees(i):.4f} 0.0 {math.degrees(a):.4f}"
        for m, i, a, p in zip(md, inc, azi, positions, strict=True)
    ]
    names = "MD X Y Z TVD DX DY AZIM_TN INCL DLS AZIM_GN"
    where = ["# WELL HEAD X-COORDINATE: 431200.0 (m)", "# WELL HEAD Y-COORDINATE: 6478300.0 (m)"]
    return "\n".join(["# WELL TRACE FROM PETREL", *where, *head, names, *rows]).encode()


@given(lists(), st.sampled_from(["m", "ft"]))
def test_a_petrel_trace_may_have_depths_in_feet_and_coordinates_in_metres(stations, unit):
    # Where all angles are that small, the reader asks whether they are radians.
    assume(max(np.max(stations[1]), np.max(stations[2])) > math.radians(10.0))
    elevation = f"# WELL DATUM (KB, Kelly bushing, from MSL): {25.0 / LENGTH_UNITS[unit]:.4f} ({unit})"
    read = list_of(petrel(stations, unit, [elevation, "# DX DY ARE GIVEN IN GRID NORTH IN m-UNITS"]))
    assert_same(read, stations, 1e-4)
    np.testing.assert_allclose(read.positions, mc.path(*stations, (0.0, 0.0, stations[0][0])), atol=0.01)


@pytest.mark.parametrize("bend", [3.0, 20.0])
def test_depths_in_feet_beside_coordinates_in_metres_are_refused_where_the_head_says_metres(bend):
    md = np.arange(0.0, 400.0, 30.0)
    inc = np.radians(np.minimum(bend, 0.08 * bend * np.maximum(md - 90.0, 0.0) / 10.0))
    stations = md, inc, np.full(md.size, 1.2)
    with pytest.raises(ListFileError, match=r"feet.*MD \(ft\)"):
        list_of(petrel(stations, "ft", ["# WELL DATUM (KB, Kelly bushing, from MSL): 25.0 (m)"]))


def archive(*names):
    import zipfile

    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as file:
        for name in names:
            file.writestr(name, "x")
    return out.getvalue()


OLE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600)


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (OLE + "Workbook".encode("utf-16-le"), "BIFF8"),
        (OLE + "Book".encode("utf-16-le"), "BIFF5"),
        (OLE + "WordDocument".encode("utf-16-le"), "Word"),
        (OLE + "EncryptedPackage".encode("utf-16-le"), "password"),
        (b"\x09\x08\x08\x00\x00\x05\x05\x00" + bytes(60), "BIFF5"),
        (archive("xl/workbook.bin"), ".xlsb"),
        (archive("mimetype", "content.xml"), ".ods"),
        (archive("a.txt"), "archive"),
        (b"<html><body><p>Error 404</p></body></html>", "HTML document without a table"),
        (b"H0100SURVEY A-1\nH0200UKOOA P7/2000 WELL DEVIATION\nP7 1\n", "P7/2000"),
        (b"%PDF-1.4", "PDF"),
    ],
)
def test_a_file_that_is_not_read_is_named_with_what_to_export(data, named):
    with pytest.raises(ListFileError) as caught:
        list_of(data, "survey.xls")
    assert named in str(caught.value)
    assert "CSV" in str(caught.value)


@given(st.lists(st.tuples(st.sampled_from("12"), st.sampled_from("16")), max_size=8))
def test_each_p7_record_is_a_station_or_is_counted_once_as_left_out(others):
    """Table 1 is the first table; status 6 is a projected station."""
    records = [("1", "1"), *others]
    text = "".join(
        f"P7,0,{table},1,,,,D,{status},,{30.0 * k},1.0,2.0,,,,,,,,\n" for k, (table, status) in enumerate(records)
    )
    got = p7_table(text, "run.p717")
    assert len(got.rows) == records.count(("1", "1"))
    assert len(got.rows) + sum(one.values["rows"] for one in got.remarks) == len(records)
