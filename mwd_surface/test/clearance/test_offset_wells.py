# SPDX-License-Identifier: Apache-2.0
"""Files of offset wells: what they name, the norths they are turned from, what cannot be used."""

import math

import example_surveys as example
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.clearance.clearance import ClearanceLevel
from mwd_surface.clearance.offset_wells import OffsetWell, OffsetWellError, clearances, offset_well, read_offset_wells
from mwd_surface.list_files.list_file import read_list
from mwd_surface.list_files.remark import RemarkKind, sentences
from mwd_surface.surveys.imported_list import survey_list
from mwd_surface.surveys.well_position import uncertain_well
from mwd_surface.uncertainty.error_terms import ErrorReference

REFERENCE = ErrorReference(math.radians(60), 50e-6, math.radians(72), math.radians(2.0), math.radians(-1.0))


def drilled():
    whole = example.surveys()
    path = whole.definitive(bit_depth=642.5)
    return uncertain_well(whole, path, 0.155)


def listed(tmp_path, north="grid"):
    """A vertical well and one that runs beside the example's, 20 m to the south."""
    (tmp_path / "straight.csv").write_text(f"md_m,inc_deg,azi_{north}_deg\n0,0,0\n300,0,0\n900,0,0\n")
    rows = "\n".join(f"{30 * k},{max(0.0, 4.0 * (k - 11))},79" for k in range(25))
    (tmp_path / "beside.csv").write_text(f"md_m,inc_deg,azi_{north}_deg\n{rows}\n")


def written(tmp_path, text):
    listed(tmp_path)
    path = tmp_path / "wells.yaml"
    path.write_text(text)
    return path


def test_the_nearest_by_the_rule_comes_first_and_what_cannot_be_used_is_named(tmp_path):
    path = written(
        tmp_path,
        """
wells:
  - {name: A-2, file: straight.csv, north_m: 60.0, east_m: 300.0, code: GYRO-NS}
  - {name: A-3, file: beside.csv, north_m: -20.0, wellhead_sigma_m: 0.5}
  - {name: A-4, file: lost.csv, north_m: 9.0}
  - {name: A-5, file: straight.csv}
""",
    )
    found, remarks = clearances(drilled(), read_offset_wells(path))
    refused = sentences(one for one in remarks if one.kind in (RemarkKind.NOT_COMPARED, RemarkKind.SPARSE))
    assert [c.name for c in found] == ["A-3", "A-2"]
    assert found[0].factor[found[0].least] < found[1].factor[found[1].least]
    assert any("A-4" in text and "lost.csv" in text for text in refused)
    assert any("A-5 lies in the same place as Ω-1 ST0" in text for text in refused)
    assert any("A-2 has stations 600 m apart" in text for text in refused)


def test_a_plan_counts_as_surveyed_at_the_usual_spacing(tmp_path):
    allowed = []
    for planned in ("true", "false"):
        path = written(
            tmp_path, f"wells: [{{name: A-2, file: straight.csv, north_m: 60.0, east_m: 300.0, planned: {planned}}}]"
        )
        found, remarks = clearances(drilled(), read_offset_wells(path))
        allowed.append(found[0].allowed[found[0].least])
        assert bool(remarks) is (planned == "false")
    assert allowed[0] < 0.5 * allowed[1]
    assert found[0].level == ClearanceLevel.CLEAR


@pytest.mark.parametrize(("north", "turn"), [("grid", 0.0), ("true", 1.0), ("magnetic", 3.0)])
def test_lists_from_another_north_are_turned_to_that_of_the_well(tmp_path, north, turn):
    listed(tmp_path, north)
    got = offset_well(OffsetWell("A-3", "beside.csv", 5.0, 7.0, 2.0), tmp_path, North.GRID, REFERENCE)
    # Grid north lies 1 deg west of true north, magnetic north 2 deg east.
    assert math.degrees(got.azimuth[-1]) == pytest.approx(79.0 + turn)
    np.testing.assert_allclose(got.positions[0], [5.0, 7.0, 2.0])
    away = got.positions[-1, :2] - got.positions[0, :2]
    assert math.degrees(math.atan2(away[1], away[0])) == pytest.approx(79.0 + turn)


@pytest.mark.slow
def test_a_better_wellhead_and_a_better_tool_give_a_larger_factor(tmp_path):
    listed(tmp_path)
    factors = []
    for extra in ("wellhead_sigma_m: 3.0", "code: UNKNOWN", "code: MWD+IFR2+SAG+MS"):
        path = tmp_path / "one.yaml"
        path.write_text(f"wells:\n  - {{name: A-3, file: beside.csv, north_m: -20.0, {extra}}}\n")
        found, _ = clearances(drilled(), read_offset_wells(path))
        factors.append(found[0].factor[found[0].least])
    assert factors[2] > max(factors[:2])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("well: []", "expected a table with wells"),
        ("wells: [{name: A, file: straight.csv}]\nrule: {k: 0.5}", "below the lowest allowed"),
        ("wells: [{name: A}]", "file"),
        ("wells: [{name: A, file: straight.csv, easting_m: 3.0}]", "easting_m"),
        ("wells: [{name: A, file: straight.csv}, {name: A, file: beside.csv}]", "two wells are named A"),
        ("{", "not YAML"),
    ],
)
def test_a_file_that_cannot_be_used_is_told_in_a_sentence(tmp_path, text, words):
    with pytest.raises(OffsetWellError, match=words):
        read_offset_wells(written(tmp_path, text))
    with pytest.raises(OffsetWellError, match="No such file"):
        read_offset_wells(tmp_path / "none.yaml")


def test_a_list_that_begins_at_depth_is_compared_with_the_hole_above_as_mwd_path_adds_it(tmp_path):
    """300 m of hole without stations next to the well: the same factor as with the vertical rows written out."""
    listed(tmp_path)
    rows = [f"{30 * k},0.0,79" for k in range(11)] + [f"{300 + 30 * k},{3.0 * k},259" for k in range(1, 12)]
    for name, kept in (("whole", rows), ("cut", rows[10:])):
        (tmp_path / f"{name}.csv").write_text("md_m,inc_deg,azi_grid_deg\n" + "\n".join(kept) + "\n")
    text = "wells:\n" + "".join(
        f"  - {{name: {name}, file: {name}.csv, north_m: 0.3, code: GYRO-NS}}\n" for name in ("whole", "cut")
    )
    path = written(tmp_path, text)
    found, remarks = clearances(drilled(), read_offset_wells(path))
    whole, cut = (next(one for one in found if one.name == name) for name in ("whole", "cut"))
    # The position of an assumed hole is not more certain than that of a surveyed one.
    assert cut.factor[cut.least] <= whole.factor[whole.least] + 0.01
    assert [one.kind for one in remarks if "cut" in one.text] == [RemarkKind.HOLE_ABOVE_ASSUMED]
    read = survey_list(read_list(tmp_path / "cut.csv")).definitive()
    used = offset_well(OffsetWell("cut", "cut.csv"), tmp_path, North.GRID, REFERENCE)
    np.testing.assert_array_equal(used.positions, read.positions)
    np.testing.assert_array_equal(used.md, read.md)


def test_a_list_whose_hole_above_is_not_known_says_from_where_it_is_compared(tmp_path):
    listed(tmp_path)
    (tmp_path / "deep.csv").write_text(
        "md_m,inc_deg,azi_grid_deg,tvd_m,north_m,east_m\n300,30,79,250,80,10\n330,30,79,275.98,82.86,24.72\n"
    )
    path = written(tmp_path, "wells: [{name: A-6, file: deep.csv, north_m: 60.0}]")
    _, remarks = clearances(drilled(), read_offset_wells(path))
    not_compared = [one for one in remarks if one.kind == RemarkKind.NOT_COMPARED]
    assert [one.values for one in not_compared] == [{"from": 0.0, "to": 300.0}]


TO_TRUE = {"true": 0.0, "magnetic": 2.0, "grid": -1.0}  # of REFERENCE, deg
STEPS = np.arange(0.0, 1501.0, 30.0)
BUILT = np.clip((STEPS - 150.0) * 0.1, 0.0, 70.0)


def deep_list(path, north, azimuth, first, *, charted=False):
    """A list from station `first` on with positions of its own, as written by someone who uses another north."""
    azi = np.full_like(STEPS, azimuth)
    positions = mc.path(STEPS, np.radians(BUILT), np.radians(azi), (0.0, 0.0, 0.0))
    # Map coordinates are those of the grid whatever the azimuths are from.
    turn = math.radians(TO_TRUE["grid"] - TO_TRUE[north]) if charted else 0.0
    level = (positions[:, 0] + 1j * positions[:, 1]) * np.exp(-1j * turn)
    names = ("Northing", "Easting") if charted else ("N/S", "E/W")
    head = "Wellhead Northing: 6478300.0 m\nWellhead Easting: 431200.0 m\n" if charted else ""
    n, e = (level.real + 6478300.0, level.imag + 431200.0) if charted else (level.real, level.imag)
    rows = (
        f"{m:.3f},{i:.4f},{a % 360.0:.4f},{d:.4f},{x:.4f},{y:.4f}"
        for m, i, a, d, x, y in zip(STEPS, BUILT, azi, positions[:, 2], n, e, strict=True)
    )
    text = f"{head}MD (m),Inc (deg),Azi {north} (deg),TVD (m),{names[0]} (m),{names[1]} (m)\n"
    path.write_text(text + "\n".join(list(rows)[first:]) + "\n")


@given(
    st.sampled_from(list(TO_TRUE)),
    st.sampled_from(list(TO_TRUE)),
    st.floats(0.0, 359.0),
    st.integers(0, 40),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_a_list_is_the_same_hole_in_any_north_from_any_first_station(
    tmp_path_factory, written_in, well_in, azimuth, first, charted
):
    folder = tmp_path_factory.mktemp("offset")
    deep_list(folder / "x.csv", written_in, azimuth, first, charted=charted)
    got = offset_well(OffsetWell("X", "x.csv"), folder, North[well_in.upper()], REFERENCE)
    turned = math.radians(azimuth + TO_TRUE[written_in] - TO_TRUE[well_in])
    want = mc.path(STEPS, np.radians(BUILT), np.full_like(STEPS, turned), (0.0, 0.0, 0.0))
    # The turn of a chart is that which fits the list's own columns.
    np.testing.assert_allclose(got.positions[-1], want[-1], atol=0.2 if charted else 0.02)


@pytest.mark.parametrize("blank", ["", "-", "-999.25"])
def test_an_offset_list_may_leave_the_azimuth_of_a_vertical_hole_blank(tmp_path, blank):
    text = "md_m,inc_deg,azi_grid_deg\n0,0,{0}\n300,0,{0}\n330,3,79\n360,6,79\n"
    for name, azimuth in (("blank.csv", blank), ("filled.csv", "79")):
        (tmp_path / name).write_text(text.format(azimuth))
    blank_well, filled = (
        offset_well(OffsetWell("X", name), tmp_path, North.GRID, REFERENCE) for name in ("blank.csv", "filled.csv")
    )
    np.testing.assert_allclose(blank_well.positions, filled.positions, atol=1e-9)


@pytest.mark.parametrize(
    ("head", "rows", "options"),
    [
        ("d,i,a", "0,0,0\n30,3,79\n", {"columns": "md=d,inc=i,azi=a", "length_unit": "m"}),
        ("md_m,dip,azi_deg", "0,90,0\n30,87,79\n", {"dip": "down"}),
        ("md_m,inc,azi", "0,0,0\n30,3.3333333,87.7777778\n", {"angle_unit": "grad"}),
        ("md_m\tinc\tazi", "0\t0\t0\n30\t3,000\t79,000\n", {"decimal": "comma"}),
    ],
)
def test_what_a_message_asks_for_can_be_said_of_an_offset_well(tmp_path, head, rows, options):
    (tmp_path / "x.csv").write_text(f"{head}\n{rows}")
    (tmp_path / "wells.yaml").write_text(yaml.safe_dump({"wells": [{"name": "X", "file": "x.csv", **options}]}))
    wells = read_offset_wells(tmp_path / "wells.yaml")
    got = offset_well(wells.wells[0], tmp_path, North.GRID, REFERENCE)
    np.testing.assert_allclose(np.degrees([got.inclination[-1], got.azimuth[-1]]), [3.0, 79.0], atol=1e-5)


def test_the_wellhead_of_an_offset_list_can_be_given(tmp_path):
    rows = "1000,30,90,950,6478300,431400\n1030,30,90,975.98,6478300,431415\n"
    (tmp_path / "x.csv").write_text(f"md_m,inc_deg,azi_grid_deg,tvd_m,northing_m,easting_m\n{rows}")
    with pytest.raises(OffsetWellError, match="wellhead"):
        offset_well(OffsetWell("X", "x.csv"), tmp_path, North.GRID, REFERENCE)
    offset = OffsetWell("X", "x.csv", wellhead="6478300,431200")
    got = offset_well(offset, tmp_path, North.GRID, REFERENCE)
    np.testing.assert_allclose(got.positions[0], [0.0, 200.0, 950.0])
