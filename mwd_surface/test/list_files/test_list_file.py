# SPDX-License-Identifier: Apache-2.0
"""Lists of stations as engineers send them, and the line number of what is wrong with the others."""

import contextlib
import csv
import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import budgets
from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import list_of, read_list
from mwd_surface.list_files.remark import RemarkKind
from mwd_surface.trajectory.plan import plan_from_list, read_plan
from project import GOLDEN, REFERENCE_DATA

GOOD = "md_m,inclination_deg,azimuth_deg\n0,0,0\n500,0,45\n1000,30,45\n"


def table(text):
    return plan_from_list(list_of(text.encode(), "plan.csv"))


def test_a_plain_table_is_read():
    got = table(GOOD)
    assert got.md.tolist() == [0.0, 500.0, 1000.0]
    assert math.degrees(got.inclination[-1]) == pytest.approx(30.0)
    assert got.positions[-1][0] == pytest.approx(got.positions[-1][1])


@pytest.mark.parametrize(
    "text",
    [
        "# Plan 3\n# grid\nMD [m];Inc (deg);Azi Grid (deg)\n0,0;0,0;0,0\n500,0;0,0;45,0\n1000,0;30,0;45,0\n",
        "MD\tINCL\tAZIM\nm\tdeg\tdeg\n0\t0\t0\n500\t0\t45\n1000\t30\t45\n",
        "\ufeffmeasured depth (ft),inclination,azimuth\n0,0,0\n1640.419948,0,45\n3280.839895,30,45\n",
        "Well: Alpha\nRun 3\nMD (m)  Inc  Azi\n0   0  0\n500  0  45\n1000  30  45\n",
        "Measured Depth [m];Inclination [gon];Azimuth [gon]\n0;0;0\n500;0;50\n1000;33,33333333333;50\n",
        "md_m,inc,azi\n0,0,0\n500,0,45\n500,0,45\n1000,30,45\n",
        "name,azi_rad,md_m,inc_rad\na,0,0,0\nb,0.785398163397,500,0\nc,0.785398163397,1000,0.523598775598\n",
    ],
)
def test_units_separators_and_orders_of_columns_are_understood(text):
    got = table(text)
    np.testing.assert_allclose(got.positions, table(GOOD).positions, atol=1e-5)


def test_the_north_that_the_header_names_is_kept():
    assert table(GOOD.replace("azimuth_deg", "azi_grid_deg")).north == "grid"
    assert table(GOOD).north == ""


@pytest.mark.fault_case(40)
@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "plan.csv: empty"),
        ("# only remarks\n", "plan.csv: empty"),
        ("md_m,azimuth_deg\n0,0\n", "line 1: no column for inclination; expected a header such as md_m"),
        ("0,0,0\n500,0,45\n", "line 1: no column for md"),
        (GOOD.replace("md_m", "md"), "line 1: md (column 'md') has no unit; write md_m or md_ft"),
        (GOOD.replace("md_m", "md (furlong)"), "line 1: md in 'furlong'"),
        ("md,inc,azi\nrods,deg,deg\n0,0,0\n1,0,0\n", "line 1: md in 'rods'"),
        (GOOD.replace("500,0,45", "500,x,45"), "line 3: inclination: expected a finite number, got 'x'"),
        (GOOD.replace("500,0,45", "500"), "line 3: 1 fields, the header names inclination as number 2"),
        (GOOD.replace("1000,30", "1000,300"), "line 4: inclination 300 deg is outside 0 to 180"),
        (GOOD.replace("500,0,45", "500,0,400"), "line 3: azimuth 400 deg"),
        (GOOD.replace("1000,30", "400,30"), "line 4: measured depth 400 m does not increase after 500 m"),
        ("md_m,inc,azi\n10,0,0\n", "a plan needs at least two stations, got 1"),
        (
            "md_m,inc,azi,tvd_m\n0,0,0,0\n1000,0,0,3280\n",
            "line 3: tvd 3280.00 m does not fit the angles, which give 1000.00 m",
        ),
        ("md_m,inc,azi\n0,90,0\n10,90,180\n", "line 3: the hole turns by 180.0 deg over 10.00 m"),
        ("inc,azi,md_m\n0\n1,2,3\n", "line 2: 1 fields, the header names azimuth as number 2"),
        (GOOD.replace("500,0,45", "500,0," + "9" * 200_000), "line 3 has 200006 characters"),
    ],
)
def test_what_is_wrong_is_reported_with_its_line(text, says):
    with pytest.raises(ListFileError, match=r"plan\.csv") as error:
        table(text)
    assert says in str(error.value)


def test_a_missing_or_huge_file_is_reported(tmp_path, monkeypatch):
    with pytest.raises(ListFileError, match="No such file"):
        read_plan(tmp_path / "none.csv")
    (tmp_path / "big.csv").write_text(GOOD)
    monkeypatch.setattr(budgets, "LIST", dataclasses.replace(budgets.LIST, size=10))
    with pytest.raises(ListFileError, match="larger than"):
        read_plan(tmp_path / "big.csv")


NEARLY = st.text(alphabet="md_inclaz,;0123456789.-\n\t ", max_size=200)


@given(st.binary(max_size=300) | NEARLY.map(lambda text: f"md_m,inc,azi\n{text}".encode()))
def test_no_bytes_raise_anything_but_a_list_file_error(data):
    with contextlib.suppress(ListFileError):
        list_of(data)


def station(md, inc, azi, uom="m"):
    return (
        f'<trajectoryStation uid="{md}"><typeTrajStation>interpolated</typeTrajStation><md uom="{uom}">{md}</md>\n'
        f'<incl uom="dega">{inc}</incl><azi uom="dega">{azi}</azi></trajectoryStation>\n'
    )


def document(*stations):
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<trajectorys xmlns="http://www.witsml.org/schemas/1series" version="1.4.1.1">\n'
        "<trajectory><nameWell>w</nameWell><nameWellbore>b</nameWellbore><name>Plan 7</name>"
        "<aziRef>grid north</aziRef>\n" + "".join(stations) + "</trajectory></trajectorys>"
    ).encode()


def test_a_witsml_trajectory_is_a_plan(tmp_path):
    path = tmp_path / "plan.xml"
    path.write_bytes(document(station(0, 0, 0), station(500, 0, 45), station(1000, 30, 45)))
    got = read_plan(path)
    np.testing.assert_array_equal(got.positions, table(GOOD).positions)
    assert (got.north, got.name) == ("grid", "Plan 7")
    feet = plan_from_list(list_of(document(station(0, 0, 0, "ft"), station(1000, 0, 0, "ft"))))
    assert feet.positions[-1][2] == pytest.approx(304.8)


@pytest.mark.fault_case(83)
@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"<a>", "not well-formed XML"),
        (b"<a/>", "line 1: the document has no trajectory of WITSML"),
        (document(station(0, 0, 0)), "a plan needs at least two stations, got 1"),
        (document(station(0, 0, 0), station("NaN", 0, 0)), "line 6: md: expected a finite number, got 'NaN'"),
        (document(station(0, 0, 0), station(9, 0, 0, "furlong")), "md in 'furlong'"),
        (document("<trajectoryStation/>"), "line 4: the station has no md"),
        (b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/hostname">]><a>&x;</a>', "no trajectory"),
    ],
)
def test_what_is_wrong_with_an_xml_plan_is_reported(data, says):
    with pytest.raises(ListFileError) as error:
        plan_from_list(list_of(data, "plan.xml"))
    assert says in str(error.value)


def test_the_example_trajectory_of_the_schemas_is_one_station_and_says_so():
    example = REFERENCE_DATA / "witsml" / "trajectory_1411_valid.xml"
    with pytest.raises(ListFileError, match="at least two stations, got 1"):
        read_plan(example)


def test_the_volve_f4_table_is_a_plan_whose_own_tvd_fits():
    f4 = REFERENCE_DATA / "volve" / "F-4_gyro_ns_trajectory.csv"
    got = read_plan(f4)
    assert got.md.size == 87
    assert got.north == "true"


def test_a_list_with_stations_left_out_fits_its_positions_less_closely():
    f5 = read_list(REFERENCE_DATA / "volve" / "volve_F5_raw_sixaxis.csv")
    assert f5.md.size == 3
    assert f5.north == "grid"
    assert np.diff(f5.md).max() > 1000.0
    with pytest.raises(ListFileError, match=r"north .* does not fit the angles"):
        # North in feet.
        table("md_m,inc,azi,tvd_m,north_m,east_m\n0,90,0,0,0,0\n30,90,0,0,98,0\n60,90,0,0,197,0\n")


def test_columns_units_and_north_can_be_named():
    data = b"TDEP;DEV;HAZI\n0;0;0\n1000;100;50\n"
    columns = {"md": "TDEP", "inclination": "DEV", "azimuth": "HAZI"}
    got = list_of(data, given=Given(columns, length_unit="ft", angle_unit="grad", north="grid"))
    np.testing.assert_allclose(got.md, [0.0, 304.8])
    np.testing.assert_allclose(np.degrees([got.inclination[1], got.azimuth[1]]), [90.0, 45.0])
    assert got.north == "grid"
    for wrong in ({"columns": {"dept": "TDEP"}}, {"length_unit": "rod"}, {"angle_unit": "mil"}, {"north": "up"}):
        with pytest.raises(ValueError, match="choose one of"):
            Given(**wrong)


@pytest.mark.parametrize(
    ("head", "declination", "convergence"),
    [
        ("Magnetic declination: 1.35 E; Grid convergence -0.7", 1.35, -0.7),
        ("Declination (deg) = -1.35\nConvergence angle: 0.7 deg West", -1.35, -0.7),
        ("# GRID CONVERGENCE: 0,70°", math.nan, 0.7),
        ("Declination date: 2026-03-01, model IGRF 14\nDeclination: 2026-03-01", math.nan, math.nan),
        ("Convergence: -0.7 W", math.nan, math.nan),
        ("Convergence 0.0122 rad", math.nan, math.nan),
    ],
)
def test_declination_and_convergence_of_the_head_are_the_reference_of_the_stations(head, declination, convergence):
    got = list_of(f"{head}\nNorth reference: grid\n\n{GOOD}".encode(), "list.csv")
    for name, wanted in (("declination", declination), ("convergence", convergence)):
        assert np.degrees(got.figures[name]) == pytest.approx(np.full(3, wanted), nan_ok=True)


def test_our_surveys_csv_comes_with_north_verdict_sigma_and_reference():
    text = (
        "sequence,md_m,inclination_deg,azimuth_deg,azimuth_reference,verdict,sigma_inclination_deg,sigma_azimuth_deg,"
        "b_reference_nt,dip_reference_deg,declination_deg\n"
        "1,100,0.2,,,accept,0.1,,50000,70,2\n2,130,20,40,grid,doubtful,0.1,0.5,50000,70,2\n"
    )
    got = list_of(text.encode())
    assert (got.north, got.verdict) == ("grid", ("accept", "doubtful"))
    assert math.isnan(got.azimuth[0])
    assert math.degrees(got.sigma_azimuth[1]) == pytest.approx(0.5)
    assert got.figures["b_reference"].tolist() == pytest.approx([50e-6, 50e-6])
    assert math.degrees(got.figures["declination"][0]) == pytest.approx(2.0)
    with pytest.raises(ListFileError, match="one list has azimuths from grid and true north"):
        list_of((text + "3,160,20,40,true,accept,0.1,0.5,50000,70,2\n").encode())


@pytest.mark.parametrize("run", ["faults", "stations"])
def test_the_list_of_a_run_is_read_by_its_definitive_columns(run):
    path = GOLDEN / run / "surveys.csv"
    got = read_list(path)
    with path.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["in_use"] == "yes"]
    assert rows
    for field in ("inclination", "azimuth", "sigma_inclination", "sigma_azimuth"):
        expected = np.radians([float(row[f"{field}_deg"] or "nan") for row in rows])
        np.testing.assert_allclose(getattr(got, field), expected, err_msg=field)


def test_a_las_file_is_read_by_its_curves_and_a_wrong_one_says_what_it_has():
    def las(*curves):
        return (
            "~Version\n VERS. 2.0 :\n WRAP. NO :\n~Well\n NULL. -999.25 :\n~Curve\n"
            + "".join(f" {name} :\n" for name in curves)
            + "~A\n 0 0 0\n 500 -999.25 45\n 1000 30 45\n"
        ).encode()

    got = list_of(las("DEPT.FT", "DEVI.DEG", "AZIM.DEG"))
    assert got.md.tolist() == pytest.approx([0.0, 304.8])
    assert [(r.kind, r.values) for r in got.remarks] == [
        (RemarkKind.NULL_VALUES, {"cells": 1}),
        (RemarkKind.ROWS_LEFT_OUT, {"rows": 1}),
    ]
    with pytest.raises(ListFileError, match=r"no column for azimuth.* got DEPT, DEVI, GR"):
        list_of(las("DEPT.FT", "DEVI.DEG", "GR.API"))
    with pytest.raises(ListFileError, match=r"cannot be read as LAS|no column"):
        list_of(b"~V\nno LAS at all")


@given(
    azimuth=st.floats(20.0, 175.0),
    walk=st.floats(-3.0, 3.0),
    build=st.floats(1.5, 5.0),
    vertical=st.integers(0, 5),
    lateral=st.booleans(),
)
def test_columns_of_inclination_and_azimuth_that_are_exchanged_are_noticed(azimuth, walk, build, vertical, lateral):
    """A path was computed without a word: it is as smooth as the path of the list read rightly."""
    built = [build * k for k in range(1, 9)]
    inclination = [88.0] * 6 if lateral else [0.0] * vertical + built
    bearing = [azimuth + walk * (v > 0.0) * k for k, v in enumerate(inclination)]
    bearing = (
        [120.0 + v / 10.0 for v in bearing]
        if lateral
        else [v if i else 0.0 for v, i in zip(bearing, inclination, strict=True)]
    )
    rows = [f"{30.0 * k:g},{i:.3f},{a:.3f}" for k, (i, a) in enumerate(zip(inclination, bearing, strict=True))]

    def noticed(names):
        try:
            read = list_of("\n".join([f"md_m,{names}", *rows]).encode(), "plan.csv")
        except ListFileError as error:
            return "exchanged" in str(error)
        return any(remark.kind == RemarkKind.COLUMNS_EXCHANGED for remark in read.remarks)

    assert noticed("azimuth_deg,inclination_deg")
    assert not noticed("inclination_deg,azimuth_deg")


def test_exchanged_columns_that_the_positions_refute_or_the_user_chose_are_no_remark():
    text = "md_m,azimuth_deg,inclination_deg{}\n0,0,0{}\n500,0,45{}\n1000,30,45{}\n"
    exchanged = {RemarkKind.COLUMNS_EXCHANGED}
    assert exchanged <= {one.kind for one in list_of(text.format(*[""] * 4).encode(), "a.csv").remarks}
    chosen = Given(columns={"inclination": "inclination_deg", "azimuth": "azimuth_deg"})
    assert not exchanged & {one.kind for one in list_of(text.format(*[""] * 4).encode(), "a.csv", chosen).remarks}
    with pytest.raises(ListFileError, match="inclination and azimuth are exchanged"):
        list_of(text.format(",tvd_m", ",0", ",500", ",977.44").encode(), "a.csv")
