# SPDX-License-Identifier: Apache-2.0
"""The direction of the dips of a hole: which lines of a head state it, and what its vertical depths say."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import list_of
from mwd_surface.list_files.remark import RemarkKind

COLUMNS = "md_m,dip_deg,azimuth_deg"
ROWS = "0,5,30\n30,5,30\n60,6,31\n"
OTHER_DIPS = (
    "Magnetic dip 62.5 deg, positive down",
    "Mag dip angle: 62.5 (positive downwards)",
    "Geomagnetic reference: total field 49650 nT, dip 62.5 deg, positive down",
    "Earth field dip angle positive down",
    "Reference dip 62.5, positive down",
    "IGRF 2025: dip angle 62.5 deg positive down",
    "B total 49650 nT; dip 62.5; positive dip down",
    "Field: dip 62.5 deg, positive down",
    "Declination 3.1 deg east, dip 62.5 deg positive down",
    "Dip: 62.5 deg (positive down)",
    "Inclination of the magnetic field, positive down: 62.5 deg",
    "Formation dip 3 deg, positive down",
    "Bedding dip angle, positive down",
    "磁倾角 62.5°，向下为正",
    "地磁场倾角(向下为正): 62.5",
    "磁场参考：总场 49650 nT，倾角 62.5 度，向下为正",
    "参考倾角 62.5，向下为正",
    "煤层倾角 12°，向下为正",
    "岩层倾角向下为正",
    "Магнитное наклонение (dip) positive down",
)
HOLE_DIPS = (
    "Dip positive up",
    "Dips of the hole: positive upwards",
    "Azimuth reference: magnetic; dip positive up",
    "Dip angles are positive up, azimuths from magnetic north",
    "Dip (0 = horizontal), positive up",
    "Dip angle: positive up, 90 is vertical",
    "Collar dip 5 deg, positive up",
    "Inclination from horizontal, positive up",
    "Tool: magnetic multishot; dip positive up",
    "Field: Alpha, dip positive up",
    "倾角向上为正",
    "方位角：磁北；倾角上倾为正",
    "钻孔倾角以向上为正",
    "钻孔倾角 5°，向上为正",
)


def read(*head, columns=COLUMNS, rows=ROWS, **said):
    text = "".join(f"# {line}\n" for line in head) + f"{columns}\n{rows}"
    return list_of(text.encode(), "list.csv", given=Given(**said))


def first(stations):
    return math.degrees(stations.inclination[0])


@pytest.mark.parametrize("line", OTHER_DIPS)
def test_a_line_about_another_dip_does_not_say_where_those_of_the_hole_point(line):
    assert first(read(line, usual_dip="up")) == pytest.approx(95.0)
    with pytest.raises(ListFileError, match="does not say whether"):
        read(line)


@pytest.mark.parametrize("line", HOLE_DIPS)
def test_a_line_about_the_dips_of_the_hole_is_heard(line):
    assert first(read(line)) == pytest.approx(95.0)
    assert first(read(line, usual_dip="down")) == pytest.approx(95.0)


@given(
    heads=st.lists(st.sampled_from((*OTHER_DIPS, *HOLE_DIPS, "Dip positive down")), max_size=4),
    usual=st.sampled_from(("", "up", "down")),
    upwards=st.booleans(),
    name=st.sampled_from(("dip_deg", "dip_up_deg", "dip_down_deg", "倾角(°)")),
)
def test_vertical_depths_say_the_direction_whatever_the_head_says(heads, usual, upwards, name):
    md = np.arange(0.0, 301.0, 30.0)
    inc = np.linspace(1.2, 1.75, md.size)
    path = mc.path(md, inc, np.full_like(md, 0.5))
    dips = np.degrees((1.0 if upwards else -1.0) * (inc - math.pi / 2.0))
    rows = "".join(f"{m:.2f},{d:.5f},28.6479,{t:.3f}\n" for m, d, t in zip(md, dips, path[:, 2], strict=True))
    stations = read(*heads, columns=f"md_m,{name},azimuth_deg,tvd_m", rows=rows, usual_dip=usual)
    np.testing.assert_allclose(stations.inclination, inc, atol=1e-5)
    (remark,) = (one.text for one in stations.remarks if one.kind == RemarkKind.DIP_CONVERTED)
    assert f"positive {'up' if upwards else 'down'}" in remark
    assert "vertical depths" in remark


def test_a_contradiction_of_the_vertical_depths_is_said():
    rows = "0,-5,30,0\n300,-5,30,26.15\n"
    stations = read("Dip positive down", columns=f"{COLUMNS},tvd_m", rows=rows)
    assert first(stations) == pytest.approx(85.0)
    assert any(
        "positive up as its vertical depths show, although the list states down" in r.text for r in stations.remarks
    )
    with pytest.raises(ListFileError, match="vertical depths of the list fit positive angles up"):
        read(columns=f"{COLUMNS},tvd_m", rows=rows, dip="down")
