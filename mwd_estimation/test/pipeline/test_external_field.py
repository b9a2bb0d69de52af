# SPDX-License-Identifier: Apache-2.0
"""The external field of an observatory: reading IAGA-2002, quiet level, gaps, and the vector sum with the reference."""

import datetime
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.pipeline.external_field import quiet_level, read_iaga2002, with_external
from mwd_sensors.core.frames import wrap_pi

QUIET_NT = np.array([15000.0, 500.0, 48000.0])
REFERENCE = Reference(total=5e-5, dip=1.25, declination=0.03, gravity=9.81, source="test")
DAY = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)
DAY_NS = int(DAY.timestamp()) * 10**9
MINUTE_NS = 60 * 10**9


def iaga2002(field_nt, letters="XYZF", step_s=60, station="TST", decbas=None, relative=False, day=DAY):
    """
    Text of a file: field_nt, shape (n, 3): north, east, down; nan: missing.

    decbas: baseline declination, deg, of its header, from which E and, if relative, D are reported.
    """
    north, east, down = np.asarray(field_nt, dtype=float).T
    minutes = 60.0 * np.degrees(1.0)
    horizontal = np.hypot(north, east)
    columns = {
        "X": north,
        "Y": east,
        "Z": down,
        "H": horizontal,
        "D": minutes * np.arctan2(east, north),
        "I": minutes * np.arctan2(down, horizontal),
        "F": np.hypot(horizontal, down),
    }
    if decbas is not None:
        turned = np.arctan2(east, north) - np.radians(decbas)
        columns["E"] = horizontal * np.sin(turned)
        if "E" in letters:
            columns["H"] = horizontal * np.cos(turned)
        columns["D"] = minutes * turned if relative else columns["D"]
    lines = [
        " Format                 IAGA-2002                                    |",
        f" IAGA CODE              {station}                                          |",
        f" Reported               {letters}                                         |",
        *([f" # DECBAS               {600.0 * (decbas % 360.0):06.0f} (tenths of a minute east) |"] if decbas else []),
        "DATE       TIME         DOY     " + "".join(f"{station}{letter}      " for letter in letters) + "|",
    ]
    for k in range(len(north)):
        at = day + datetime.timedelta(seconds=k * step_s)
        values = "".join(
            f"{99999.0 if np.isnan(columns[letter][k]) else columns[letter][k]:10.2f}" for letter in letters
        )
        lines.append(f"{at:%Y-%m-%d %H:%M:%S}.000 {at:%j}   {values}")
    return "\n".join(lines) + "\n"


def _day(storm_from=None):
    """A day of minutes with a little noise and from an hour on a storm of slow and quick changes."""
    rng = np.random.default_rng(5)
    field = QUIET_NT + rng.normal(0.0, 0.3, (1440, 3))
    if storm_from is not None:
        hours = np.maximum(np.arange(1440) / 60.0 - storm_from, 0.0)[:, None]
        field += np.where(hours > 0.0, [-300.0, 80.0, 120.0] * (1.0 + 0.5 * np.sin(9.0 * hours)), 0.0)
    return field


@pytest.mark.parametrize("letters", ["XYZF", "HDZF", "DHZ", "DIF"])
def test_every_usual_set_of_components_gives_the_same_field(letters):
    record = read_iaga2002(iaga2002(_day(10.0), letters), "file")
    assert record.station == "TST"
    # The format has two decimals: a hundredth of a minute of arc is 0.15 nT of this field.
    assert record.disturbance(DAY_NS + 700 * MINUTE_NS) * 1e9 == pytest.approx(_day(10.0)[700] - QUIET_NT, abs=0.6)


@pytest.mark.parametrize("base", [1.7, 9.2, -14.5, 179.5])
@pytest.mark.parametrize(("letters", "relative"), [("HEZF", False), ("HDZF", True), ("HDZF", False), ("XYZF", False)])
def test_a_baseline_declination_gives_the_same_field_in_every_form(letters, relative, base):
    turn = np.radians(base + 0.3) - np.arctan2(QUIET_NT[1], QUIET_NT[0])
    mat = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    field = _day(10.0) @ mat.T
    record = read_iaga2002(iaga2002(field, letters, decbas=base, relative=relative), "file")
    assert record.field_n * 1e9 == pytest.approx(field, abs=2.5)


@pytest.mark.parametrize("null", [None, "88888", "99999", "999999"])
def test_h_and_e_without_a_baseline_are_refused_and_not_taken_for_north_and_east(null):
    text = iaga2002(_day()[:10], "HEZF", decbas=3.0)
    without = "\n".join(line for line in text.splitlines() if "DECBAS" not in line)
    with pytest.raises(ValueError, match="baseline declination"):
        read_iaga2002(text.replace("001800", null) if null else without, "file")


@pytest.mark.parametrize("forms", [("XYZF", "XYZF", "XYZF"), ("XYZF", "HEZF", "HDZF"), ("DIF", "XYZF", "HDZF")])
def test_files_of_several_days_joined_are_one_record_whatever_their_forms_and_order(forms):
    days = [DAY + datetime.timedelta(days=k) for k in range(3)]
    parts = [iaga2002(_day(), form, decbas=1.5, relative=True, day=day) for form, day in zip(forms, days, strict=True)]
    record, shuffled = (read_iaga2002("".join(order), "file") for order in (parts, parts[::-1]))
    assert len(record.stamps_ns) == 3 * 1440
    assert record.field_n * 1e9 == pytest.approx(np.tile(_day(), (3, 1)), abs=0.6)
    assert np.array_equal(record.field_n, shuffled.field_n)
    assert np.array_equal(record.stamps_ns, shuffled.stamps_ns)


def test_a_file_joined_of_two_observatories_is_refused_by_their_names():
    with pytest.raises(ValueError, match="TST, LER"):
        read_iaga2002(iaga2002(_day()) + iaga2002(_day(), station="LER"), "file")


@pytest.mark.parametrize("storm_from", [None, 4.0, 12.0, 20.0])
def test_the_quiet_level_does_not_see_a_storm(storm_from):
    stamps = DAY_NS + MINUTE_NS * np.arange(1440)
    assert quiet_level(stamps, _day(storm_from)) == pytest.approx(QUIET_NT, abs=1.0)


def test_between_samples_the_field_is_interpolated_and_a_long_gap_is_none():
    field = np.tile(QUIET_NT, (180, 1))
    field[101] = QUIET_NT + np.array([60.0, 0.0, 0.0])
    field[120:140] = np.nan
    record = read_iaga2002(iaga2002(field), "file")
    assert record.disturbance(DAY_NS + 100 * MINUTE_NS + 15 * 10**9)[0] * 1e9 == pytest.approx(15.0)
    assert record.disturbance(DAY_NS + 130 * MINUTE_NS) is None
    assert record.disturbance(DAY_NS - 1) is None
    assert record.disturbance(DAY_NS + 180 * MINUTE_NS) is None
    assert record.disturbance(DAY_NS + 179 * MINUTE_NS) == pytest.approx(np.zeros(3), abs=1e-12)


def test_seconds_are_read_as_well_as_minutes():
    record = read_iaga2002(iaga2002(_day()[:600], step_s=1), "file")
    assert len(record.stamps_ns) == 600
    assert np.all(np.diff(record.stamps_ns) == 10**9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("no header\n", "no line with the columns"),
        (iaga2002(_day()[:5], "XYF"), "components F, X, Y"),
        (iaga2002(np.full((5, 3), np.nan)), "0 complete samples"),
        (iaga2002(_day()[:5]) + "2026-03-01 rubbish\n", "line 10: not a line of IAGA-2002 data"),
    ],
)
def test_a_file_that_is_no_record_is_refused_in_words(text, words):
    with pytest.raises(ValueError, match=words):
        read_iaga2002(text, "file")


components = st.floats(-2e-6, 2e-6)


@given(disturbance=st.tuples(components, components, components))
def test_the_reference_becomes_the_vector_sum(disturbance):
    got = with_external(REFERENCE, np.array(disturbance), 0.2, "observatory TST")
    before = REFERENCE.horizontal * np.array([math.cos(REFERENCE.declination), math.sin(REFERENCE.declination)])
    after = got.horizontal * np.array([math.cos(got.declination), math.sin(got.declination)])
    assert (*(after - before), got.vertical - REFERENCE.vertical) == pytest.approx(disturbance, abs=1e-15)
    assert got.external.strength == pytest.approx(math.hypot(*disturbance))
    assert got.external.is_storm == (math.hypot(*disturbance) > 1e-7)


@pytest.mark.slow
def test_sigma_of_what_the_well_does_not_share_is_that_of_random_vectors():
    rng = np.random.default_rng(11)
    disturbance = np.array([-3e-7, 1e-7, 1e-7])
    got = with_external(REFERENCE, disturbance, 0.5, "observatory TST")
    left = rng.normal(0.0, 0.5 * np.linalg.norm(disturbance) / math.sqrt(3.0), (40000, 3))
    drawn = [with_external(got, one, 0.0, "") for one in left]
    for name, sigma in (("total", "sigma_total"), ("dip", "sigma_dip")):
        added = math.sqrt(getattr(got, sigma) ** 2 - getattr(REFERENCE, sigma) ** 2)
        assert np.std([getattr(one, name) for one in drawn]) == pytest.approx(added, rel=0.02)
    turned = np.std([wrap_pi(one.declination - got.declination) for one in drawn])
    added = math.sqrt(got.declination_variance(got.horizontal) - REFERENCE.declination_variance(got.horizontal))
    assert turned == pytest.approx(added, rel=0.02)


def test_without_declination_the_reference_stays_as_it_is():
    magnetic = Reference(total=5e-5, dip=1.25)
    assert with_external(magnetic, np.full(3, 1e-7), 0.2, "TST") is magnetic


@pytest.mark.parametrize("null", [88888.0, 99999.0, -99999.0, 99999.9])
@pytest.mark.parametrize("letters", ["XYZF", "HDZF"])
def test_no_null_of_a_component_becomes_a_field(null, letters):
    header, columns, data = iaga2002(np.tile(QUIET_NT, (10, 1)), letters).partition("DATE ")
    title, *lines = (columns + data).splitlines()
    for column in range(3):
        words = lines[2 + column].split()
        words[3 + column] = f"{null:.2f}"
        lines[2 + column] = " ".join(words)
    record = read_iaga2002("\n".join([header.rstrip("\n"), title, *lines]), "tst.min")
    assert len(record.stamps_ns) == 7
    assert np.allclose(1e9 * record.field_n, QUIET_NT, atol=5.0)
