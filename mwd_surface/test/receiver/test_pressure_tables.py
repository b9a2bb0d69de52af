# SPDX-License-Identifier: Apache-2.0
"""The same pressure in every table that rigs write is the same samples; what is not a number is a missing sample."""

import datetime as dt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.receiver import pressure_files

COUNT, STEP = 400, 0.02
TIME = np.arange(COUNT) * STEP
PRESSURE = 2.0e7 + 1e5 * np.random.default_rng(1).normal(size=COUNT)
START = dt.datetime(2026, 3, 1, 23, 59, 57, tzinfo=dt.UTC)


def moments():
    return [START + dt.timedelta(milliseconds=20 * k) for k in range(COUNT)]


# Way to write the time: name, unit, cells.
TIMES = {
    "seconds": ("time", "s", [f"{t:.2f}" for t in TIME]),
    "milliseconds": ("Time", "ms", [f"{1000 * t:.0f}" for t in TIME]),
    "unix seconds": ("timestamp", "", [f"{1_772_000_000 + t:.2f}" for t in TIME]),
    "unix milliseconds": ("Timestamp", "", [f"{1_772_000_000_000 + 1000 * t:.0f}" for t in TIME]),
    "iso": ("UTC Time", "", [f"{m:%Y-%m-%dT%H:%M:%S}.{m.microsecond // 1000:03d}Z" for m in moments()]),
    "iso with a space": ("DateTime", "", [f"{m:%Y-%m-%d %H:%M:%S}.{m.microsecond // 1000:03d}" for m in moments()]),
    "german": ("Zeit", "", [f"{m:%d.%m.%Y %H:%M:%S}.{m.microsecond // 1000:03d}" for m in moments()]),
    "american": (
        "Time",
        "",
        [f"{m.month}/{m.day}/{m.year} {m:%I:%M:%S}.{m.microsecond // 1000:03d} {m:%p}" for m in moments()],
    ),
    "clock over midnight": ("Rig Time", "", [f"{m:%H:%M:%S}.{m.microsecond // 1000:03d}" for m in moments()]),
}
UNITS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": 6894.757293168}


def written(time, unit, separator=",", decimal=".", units="name", comments=(), head=()):
    name, time_unit, clock = TIMES[time]
    cells = [f"{p / UNITS[unit]:.9g}" for p in PRESSURE]
    rows = [
        [
            c.replace(".", decimal)
            if time not in ("german", "iso", "iso with a space", "american", "clock over midnight")
            else c,
            "7",
            p.replace(".", decimal),
        ]
        for c, p in zip(clock, cells, strict=True)
    ]
    if units == "name":
        names = [[f"{name} ({time_unit})" if time_unit else name, "Count", f"SPP ({unit})"]]
    else:
        names = [[name, "Count", "Standpipe Pressure"], [time_unit or "-", "-", unit]]
    lines = [*head, *(separator.join(row) for row in names)]
    for k, row in enumerate(rows):
        lines += ["# pumps checked" for at in comments if at == k]
        lines.append(separator.join(row))
    return "\n".join(lines) + "\n"


def assert_same(read, tolerance=1e-6, of=PRESSURE):
    np.testing.assert_allclose(read.time_s - read.time_s[0], TIME, atol=tolerance)
    np.testing.assert_allclose(read.pressure_pa, of, rtol=1e-8)


@given(
    st.sampled_from(list(TIMES)),
    st.sampled_from(list(UNITS)),
    st.sampled_from([(",", "."), (";", ","), (";", "."), ("\t", ","), ("\t", ".")]),
    st.sampled_from(["name", "row"]),
    st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252"]),
    st.lists(st.integers(0, COUNT - 1), max_size=2),
    st.booleans(),
)
def test_the_same_pressure_in_any_table_is_the_same_samples(
    tmp_path_factory, time, unit, marks, units, encoding, comments, titled
):
    separator, decimal = marks
    head = ["Rig 7 log", "# written by the EDR"] if titled else []
    path = tmp_path_factory.mktemp("p") / "p.csv"
    path.write_bytes(written(time, unit, separator, decimal, units, comments, head).encode(encoding))
    assert_same(pressure_files.read(path))


def test_a_date_in_a_column_of_its_own_counts(tmp_path):
    rows = [
        f"{m:%d/%m/%Y},{m:%H:%M:%S}.{m.microsecond // 1000:03d},{p:.3f}"
        for m, p in zip(moments(), PRESSURE, strict=True)
    ]
    (tmp_path / "p.csv").write_text("\n".join(["Date,Time,SPP (Pa)", *rows]))
    read = pressure_files.read(tmp_path / "p.csv")
    assert_same(read)


@pytest.mark.parametrize(
    ("cell", "said"),
    [("Bad", "word in place of a number, such as 'Bad'"), ("-999.25", "null value -999.25"), ("", "not numbers")],
)
def test_a_cell_without_a_pressure_is_a_missing_sample(tmp_path, cell, said):
    cells = [cell if k % 10 == 3 else f"{p:.3f}" for k, p in enumerate(PRESSURE)]
    (tmp_path / "p.csv").write_text(
        "\n".join(["time_s,pressure_pa", *(f"{t:.2f},{c}" for t, c in zip(TIME, cells, strict=True))])
    )
    read = pressure_files.read(tmp_path / "p.csv")
    kept = np.arange(COUNT) % 10 != 3
    np.testing.assert_allclose(read.time_s, TIME[kept], atol=1e-9)
    np.testing.assert_allclose(read.pressure_pa, PRESSURE[kept], rtol=1e-9)
    assert said in " ".join(read.notes)


@pytest.mark.parametrize("first", [0, 17])
def test_samples_under_stamps_of_a_second_are_spread_evenly(tmp_path, first):
    stamps = np.floor(1_772_000_000.0 + (np.arange(COUNT) + first) * STEP)
    (tmp_path / "p.csv").write_text(
        "\n".join(["Timestamp,SPP (Pa)", *(f"{t:.0f},{p:.3f}" for t, p in zip(stamps, PRESSURE, strict=True))])
    )
    read = pressure_files.read(tmp_path / "p.csv")
    assert_same(read, 2e-3)
    assert "spread evenly" in " ".join(read.notes)


def test_a_current_loop_has_the_shape_of_the_pressure_and_a_broken_wire_is_missing(tmp_path):
    current = 4.0 + 16.0 * (PRESSURE - 1.9e7) / 2e6
    cells = ["0.02" if k == 9 else f"{c:.6f}" for k, c in enumerate(current)]
    (tmp_path / "p.csv").write_text(
        "\n".join(["time_s,loop (mA)", *(f"{t:.2f},{c}" for t, c in zip(TIME, cells, strict=True))])
    )
    read = pressure_files.read(tmp_path / "p.csv")
    assert np.corrcoef(read.pressure_pa, np.delete(PRESSURE, 9))[0, 1] == pytest.approx(1.0, abs=1e-6)
    assert "4 to 20 mA" in " ".join(read.notes)
    assert "broken wire" in " ".join(read.notes)


def test_a_table_without_names_asks_and_takes_the_answer(tmp_path):
    (tmp_path / "p.csv").write_text("\n".join(f"{t:.2f} {p / 1e5:.6f}" for t, p in zip(TIME, PRESSURE, strict=True)))
    with pytest.raises(ValueError, match="--columns time_s=1,pressure_bar=2"):
        pressure_files.read(tmp_path / "p.csv")
    assert_same(pressure_files.read(tmp_path / "p.csv", columns="time_s=1,pressure_bar=2"))


@pytest.mark.parametrize(
    ("names", "columns"),
    [
        ("Zeitpunkt;Kanal 3", "time_s=Zeitpunkt,pressure_bar=Kanal 3"),
        ("time_s;Kanal 3", "pressure_bar=2"),
        ("time_s;SPP", "pressure_bar=SPP"),
    ],
)
def test_columns_of_any_name_can_be_said(tmp_path, names, columns):
    (tmp_path / "p.csv").write_text(
        "\n".join([names, *(f"{t:.2f};{p / 1e5:.6f}" for t, p in zip(TIME, PRESSURE, strict=True))])
    )
    with pytest.raises(ValueError, match="--columns"):
        pressure_files.read(tmp_path / "p.csv")
    assert_same(pressure_files.read(tmp_path / "p.csv", columns=columns))


def test_times_without_a_unit_that_may_be_milliseconds_are_a_question(tmp_path):
    (tmp_path / "p.csv").write_text(
        "\n".join(["time,SPP (Pa)", *(f"{1000 * t:.0f},{p:.3f}" for t, p in zip(TIME, PRESSURE, strict=True))])
    )
    with pytest.raises(ValueError, match="time_ms=time"):
        pressure_files.read(tmp_path / "p.csv")
    assert_same(pressure_files.read(tmp_path / "p.csv", columns="time_ms=time"))


def test_strokes_are_read_by_the_same_rules(tmp_path):
    (tmp_path / "s.csv").write_text("Pump;Time (ms)\n1;500\n2;700\n1;1200\n")
    got = pressure_files.read_strokes(tmp_path / "s.csv")
    np.testing.assert_allclose(got[1], [0.5, 1.2])
    np.testing.assert_allclose(got[2], [0.7])
