# SPDX-License-Identifier: Apache-2.0
"""Awkward lists of one hole, and lists that are refused: each says in its message what to do."""

import math
from pathlib import Path

import numpy as np
import pytest

from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import list_of, read_list
from mwd_surface.list_files.remark import RemarkKind as Kind
from mwd_surface.list_files.station_list import start_of

EXAMPLES = Path(__file__).parent / "examples"


@pytest.mark.parametrize(
    ("name", "north", "kinds"),
    [
        ("tab_thousands.txt", "grid", set()),
        ("semicolon_comma.csv", "", set()),
        ("utf16_spaces.txt", "", set()),
        ("compass_report.txt", "grid", {Kind.ROWS_LEFT_OUT}),
        ("petrel_trace.dev", "grid", {Kind.COLUMN_CHOSEN, Kind.UNIT_ASSUMED, Kind.MAP_SHIFTED}),
        ("nulls_and_footer.csv", "grid", {Kind.NULL_VALUES, Kind.ROWS_LEFT_OUT, Kind.AZIMUTH_MISSING}),
        ("chinese_gb18030.csv", "grid", set()),
        ("dips_with_tvd.csv", "grid", {Kind.DIP_CONVERTED}),
        ("las3_inclinometry.las", "grid", set()),
        ("witsml_2_1.xml", "grid", set()),
        ("p7_17.p717", "grid", {Kind.ROWS_LEFT_OUT}),
    ],
)
def test_an_awkward_list_is_read_and_says_what_was_assumed(name, north, kinds):
    read = read_list(EXAMPLES / name)
    np.testing.assert_allclose(read.md, [0.0, 500.0, 1000.0, 1030.5], atol=2e-3)
    np.testing.assert_allclose(np.degrees(read.inclination), [0.0, 0.0, 10.0, 12.0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(read.azimuth[2:]), [45.0, 46.0], atol=1e-9)
    assert read.north == north
    assert {one.kind for one in read.remarks} == kinds


@pytest.mark.parametrize("example", sorted(p.name for p in EXAMPLES.iterdir() if p.suffix != ".md"))
def test_the_name_of_a_file_says_nothing(example, tmp_path):
    renamed = tmp_path / "list.bin"
    renamed.write_bytes((EXAMPLES / example).read_bytes())
    original, other = read_list(EXAMPLES / example), read_list(renamed)
    np.testing.assert_array_equal(original.md, other.md)
    assert original.north == other.north


@pytest.mark.parametrize(
    ("text", "quoted"),
    [
        ("md_m,inc,azi (Lambert)\n0,0,0\n100,5,30\n", "lambert"),
        ("MD (chains),inc,azi\n0,0,0\n10,5,30\n", "chains"),
        ("md_m,inc (mils),azi\n0,0,0\n100,5,30\n", "mils"),
        ("md_m,inc,Azimuth Plant\n0,0,0\n100,5,30\n", "plant"),
        ("North Reference: Lambert 72\nmd_m,inc,azi\n0,0,0\n100,5,30\n", "Lambert 72"),
        ("Depth Unit: chains\nmd,inc,azi\n0,0,0\n100,5,30\n", "chains"),
        ("md_m,inc,azi,azimuth_reference\n0,0,0,plant\n100,5,30,plant\n", "plant"),
        ("md_m,inc,azi\n0,0,0\n100,5 mils,30\n", "5 mils"),
        ("md_m,inc,heading\n0,0,0\n100,5,30\n", "heading"),
    ],
)
def test_a_word_that_is_not_understood_is_quoted_never_treated_as_absent(text, quoted):
    with pytest.raises(ListFileError) as error:
        list_of(text.encode())
    assert quoted in str(error.value)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("md_m,inc,azi,tvd_m\n0,20,30,0\n30,21,30,10.5\n60,22,31,21.5\n", "from the horizontal"),
        ("md_ft,inc,azi,tvd_m\n0,0,0,0\n1000,0,0,1000\n2000,5,10,1998.7\n", "feet and metres"),
        ("md_m,inc,azi,north_m,east_m\n0,90,0,0,0\n100,90,0,98.48,17.36\n200,90,0,196.96,34.73\n", "+10.00 deg"),
        ("md_m,inc_deg,azi_deg,tvd_m\n0,0,0,0\n300,0.5,1,292\n600,1.0,1,530\n", "radians"),
        ("md_m,inc,azi,north_m,east_m\n0,90,30,0,0\n100,90,30,50,86.6\n200,90,30,100,173.2\n", "exchanged"),
        ("md_m,inc,azi,tvd_m\n0,0,0,0\n300,0,0,-300\n600,0,0,-600\n", "elevations"),
    ],
)
def test_angles_that_contradict_the_positions_are_refused_with_the_likely_cause(text, cause):
    with pytest.raises(ListFileError, match="likely cause") as error:
        list_of(text.encode())
    assert cause in str(error.value)


@pytest.mark.parametrize(
    ("text", "says", "given"),
    [
        ("md_m,inc,azi\n0,0,0\n1e308,1,2\n", "deeper than any hole", None),
        ("md_m,inc,azi,tvd_m\n0,0,0,0\n10,1,2,1e308\n", "farther away than any place", None),
        ("md_ft,inc,azi,north_ft,east_ft\n0,0,0,0,0\n10,1,2,-1e308,0\n", "farther away than any place", None),
        ("md_m,inc,azi\n-10,0,0\n20,1,2\n", "above the wellhead", None),
        ("md_m,inc,azi\n0,0,0\n100,10,20\n110,35,20\n", "--confirm dogleg", Given(confirm=("dogleg",))),
        ("MD (m)\tInc\tAzi\n1,000\t0\t0\n1,030\t1\t0\n1,060\t2\t0\n", "--decimal", Given(decimal="point")),
        (
            "md_m,inc,azi\n0,0.0,0.5\n100,0.05,1.52\n200,0.1,1.55\n300,0.15,1.61\n",
            "--angle-unit",
            Given(angle_unit="rad"),
        ),
        ("md_m,inc,azi\n0,0,0\n30,5,0,\n60,5;5,0\n", "expected a finite number", None),
        ("MD (m),MD (ft),inc,azi\n0,0,0,0\n100,900,1,0\n", "--columns md=NAME", Given({"md": "MD (m)"})),
        (
            "md_m,inc,azi,north_m,east_m\n0,0,0,5200,700\n100,0,0,5200,700\n",
            "--wellhead",
            Given(confirm=("wellhead",)),
        ),
        (
            "md_m,inc,azi,northing_m,easting_m\n500,30,0,6478300,431200\n530,30,0,6478315,431200\n",
            "--wellhead",
            Given(wellhead=(6478200.0, 431200.0)),
        ),
        (
            "md_m,inc,azi,x_m,y_m\n0,0,0,6478300,431200\n100,0,0,6478300,431200\n",
            "km from the wellhead",
            Given(wellhead=(6478300.0, 431200.0)),
        ),
    ],
)
def test_what_is_implausible_is_a_question_that_the_caller_can_answer(text, says, given):
    if says != "km from the wellhead":
        with pytest.raises(ListFileError) as error:
            list_of(text.encode())
        assert says in str(error.value)
        if given is not None:
            list_of(text.encode(), given=given)
        return
    with pytest.raises(ListFileError, match=says):
        list_of(text.encode(), given=given)


def test_azimuths_of_a_whole_turn_and_below_zero_are_azimuths():
    read = list_of(b"md_m,inc,azi\n0,0,360\n30,1,-90\n60,1,359.99\n")
    np.testing.assert_allclose(np.degrees(read.azimuth), [0.0, 270.0, 359.99])


def test_a_drill_hole_that_leaves_its_collar_at_an_angle_is_straight_above_its_first_station():
    start = start_of(list_of(b"md_m,inc,azi\n6,85,30\n36,86,30\n"))
    assert math.degrees(start.inclination) == pytest.approx(85.0)
    assert [one.kind for one in start.remarks] == [Kind.HOLE_ABOVE_ASSUMED]
