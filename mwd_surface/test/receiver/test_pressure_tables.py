# SPDX-License-Identifier: Apache-2.0
"""The same pressure in every table that rigs write is the same samples; what is not a number is a missing sample."""

import dataclasses
import datetime as dt
import json

import numpy as np
import openpyxl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_surface.receiver import pressure_files, table_times

COUNT, STEP = 200, 0.02
TIME = np.arange(COUNT) * STEP
PRESSURE = 2.0e7 + 1e5 * np.random.default_rng(1).normal(size=COUNT)
START = dt.datetime(2026, 3, 1, 23, 59, 57, tzinfo=dt.UTC)
MOMENTS = [START + dt.timedelta(milliseconds=20 * k) for k in range(COUNT)]
TEXTS = [(f"{t:.2f}", f"{p:.3f}") for t, p in zip(TIME, PRESSURE, strict=True)]


def clock(moment, form="%H:%M:%S"):
    """Return a moment to the millisecond."""
    return f"{moment.strftime(form)}.{moment.microsecond // 1000:03d}"


def clocks(form="%H:%M:%S", end=""):
    return [clock(moment, form) + end for moment in MOMENTS]


# Way to write the time: name, unit, cells.
TIMES = {
    "seconds": ("time", "s", [f"{t:.2f}" for t in TIME]),
    "milliseconds": ("Time", "ms", [f"{1000 * t:.0f}" for t in TIME]),
    "unix seconds": ("timestamp", "", [f"{1_772_000_000 + t:.2f}" for t in TIME]),
    "unix milliseconds": ("Timestamp", "", [f"{1_772_000_000_000 + 1000 * t:.0f}" for t in TIME]),
    "iso": ("UTC Time", "", clocks("%Y-%m-%dT%H:%M:%S", "Z")),
    "iso with a space": ("DateTime", "", clocks("%Y-%m-%d %H:%M:%S")),
    "german": ("Zeit", "", clocks("%d.%m.%Y %H:%M:%S")),
    "american": ("Time", "", [f"{m.month}/{m.day}/{m.year} {clock(m, '%I:%M:%S')} {m:%p}" for m in MOMENTS]),
    "clock over midnight": ("Rig Time", "", clocks()),
    "clock with a colon": ("Uhrzeit", "", [cell.replace(".", ":") for cell in clocks()]),
    "compact iso": ("Timestamp", "", clocks("%Y%m%dT%H%M%S", "Z")),
    "month name": ("Time", "", clocks("%d-%b-%Y %H:%M:%S")),
    "short year": ("Time", "", clocks("%d/%m/%y %H:%M:%S")),
    "minutes and seconds": ("Elapsed", "", [f"{int(t // 60):02d}:{t % 60:05.2f}" for t in TIME]),
    "spreadsheet days": ("Date Time", "", [f"{46_082 + (86_397 + t) / 86_400:.11f}" for t in TIME]),
    "windows ticks": ("Timestamp", "", [f"{134_168_000_000_000_000 + round(1e7 * t)}" for t in TIME]),
    "hours": ("Elapsed time", "h", [f"{t / 3600:.9f}" for t in TIME]),
}
UNITS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": 6894.757293168}


def written(time, unit, separator=",", decimal=".", units="name", comments=(), head=()):
    name, time_unit, cells = TIMES[time]
    if units == "name":
        names = [[f"{name} ({time_unit})" if time_unit else name, "Count", f"SPP ({unit})"]]
    else:
        names = [[name, "Count", "Standpipe Pressure"], [time_unit or "-", "-", unit]]
    lines = [*head, *(separator.join(row) for row in names)]
    for k, (cell, pressure) in enumerate(zip(cells, PRESSURE, strict=True)):
        lines += ["# pumps checked" for at in comments if at == k]
        when = cell if ":" in cell or "T" in cell else cell.replace(".", decimal)
        lines.append(separator.join([when, "7", f"{pressure / UNITS[unit]:.9g}".replace(".", decimal)]))
    return "\n".join(lines) + "\n"


def table(head, row):
    """Return the lines of a table; a row is made of its number and of its time, s, and pressure, Pa, as texts."""
    return [head, *(row(k, *texts) for k, texts in enumerate(TEXTS))]


PLAIN = table("time_s,pressure_pa", lambda _k, t, p: f"{t},{p}")


@pytest.fixture
def read(tmp_path):
    """Write the lines of a table into a file, and read its pressure."""

    def from_lines(lines, *gauge, name="p.csv", **said):
        path = tmp_path / name
        path.write_text("\n".join(lines), encoding="utf-8")
        return pressure_files.read(path, *gauge, **said)

    return from_lines


def notes(found):
    return " ".join(found.notes)


def assert_same(found, tolerance=1e-6, count=COUNT):
    np.testing.assert_allclose(found.time_s - found.time_s[0], TIME[:count], atol=tolerance)
    np.testing.assert_allclose(found.pressure_pa, PRESSURE[:count], rtol=1e-8)


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
    assert_same(pressure_files.read(path), 1e-5)


def numeric_clock(k, _time, pressure):
    """Return a row whose day and time of day are numbers."""
    later = MOMENTS[k] + dt.timedelta(seconds=3)
    return f"{later:%y%m%d},{int(f'{later:%H%M%S}')}.{later.microsecond // 1000:03d},{pressure}"


def end_of_summer_time(k, _time, pressure):
    hours = 2 if k < COUNT // 2 else 1
    return f"{clock(MOMENTS[k] + dt.timedelta(hours=hours), '%Y-%m-%d %H:%M:%S')}+0{hours}:00,{pressure}"


def second_of_two(k, _time, pressure):
    """Return a row of two quantities, each with its own time; the first has fewer samples."""
    iso = TIMES["iso"][2]
    first = f"{iso[k + 9]},7" if k < COUNT // 2 else ","
    return f"{first},{iso[k]},{pressure}"


def with_thousands(separator, decimal, mark):
    """Return a table of kPa with a mark between thousands."""
    marks = str.maketrans({",": mark, ".": decimal})

    def row(k, time, _pressure):
        return separator.join(cell.translate(marks) for cell in (time, f"{PRESSURE[k] / 1e3:,.4f}"))

    return table(f"Time (s){separator}SPP (kPa)", row)


def with_digits(start, decimal, *, padded):
    """Return a table whose clock is a number such as 235957.02."""
    first = dt.datetime.fromisoformat(f"2026-03-01T{start}")

    def row(k, _time, pressure):
        moment = first + dt.timedelta(seconds=float(TIME[k]))
        digits = f"{moment:%H%M%S}" if padded else str(int(f"{moment:%H%M%S}"))
        return f"{digits}.{moment.microsecond // 10_000:02d};{pressure}".replace(".", decimal)

    return table("TIME;SPPA (Pa)", row)


FORMS = {
    "date in a column of its own": table(
        "Date,Time,SPP (Pa)", lambda k, _t, p: f"{MOMENTS[k]:%d/%m/%Y},{clock(MOMENTS[k])},{p}"
    ),
    "date and clock as numbers": table("DATE,TIME,SPPA (Pa)", numeric_clock),
    "offset from UTC": table("Time,SPP (Pa)", end_of_summer_time),
    "names that are formats of date and clock": table(
        "YYYY/MM/DD,HH:MM:SS,Hole Depth (m),SPP (Pa)",
        lambda k, _t, p: f"{MOMENTS[k]:%Y/%m/%d},{clock(MOMENTS[k])},9,{p}",
    ),
    "average beside the pressure": table("Seconds,SPP Avg (Pa),SPP (Pa)", lambda _k, t, p: f"{t},20000000.0,{p}"),
    "units in the cells": table("Time,SPP", lambda k, t, _p: f"{t} s,{PRESSURE[k] / 1e5:.6f} bar"),
    "other pressures before the standpipe": table(
        "time_s,Diff Press (Pa),Pump Pressure (Pa),Stand Pipe Pressure (Pa),Hook load",
        lambda _k, t, p: f"{t},9.1,1.0,{p},3.0",
    ),
    "two times of one name": table("Timestamp,HKLD (kN),Timestamp,SPP (Pa)", second_of_two),
    "two times": table("HKLD Time,HKLD (kN),SPP Time,SPP (Pa)", second_of_two),
    "head of a logger": [
        *("Logger: 11", "Recorded: 03/01/2026 10:00:00", ""),
        *table("Measurement time[s],SPP [kPa]", lambda k, t, _p: f"{t},{PRESSURE[k] / 1e3:.6f}"),
    ],
    **{f"last line cut to {end}": [*PLAIN, end] for end in ("8.00,2", "8.0", "8.00,", "8")},
    **{
        head: table(head, lambda k, t, _p, unit=unit: f"{t},{PRESSURE[k] / unit:.12g}")
        for head, unit in (
            ("time_s,SPP (ksi)", 6_894_757.293168),
            ("time_s,SPP (psia)", 6894.757293168),
            ("time_s,SPP (kgf/cm2)", 98_066.5),
            ("time_s,SPP (hPa)", 100.0),
            ("time_s,SPP (kPag)", 1e3),
            ("time_s,SPP (MPa a)", 1e6),
            ("ETIM.S,SPPA.KPA", 1e3),
            ("Test time (s),Stand pipe (kPa)", 1e3),
        )
    },
    **{
        f"thousands {mark!r}, decimals {decimal!r}": with_thousands(separator, decimal, mark)
        for separator, decimal, mark in ((";", ",", "."), ("\t", ".", ","), (";", ",", "\u00a0"), ("\t", ".", "'"))
    },
    **{
        f"clock in digits from {start}, {padded=}, decimals {decimal!r}": with_digits(start, decimal, padded=padded)
        for start in ("00:59:57", "23:59:57", "09:41:58", "12:00:57")
        for padded in (True, False)
        for decimal in ".,"
    },
}


@pytest.mark.parametrize("form", FORMS)
def test_the_same_pressure_in_any_form_is_the_same_samples(read, form):
    assert_same(read(FORMS[form]))


@pytest.mark.parametrize(
    ("names", "encoding"),
    [
        ("Время (s);Давление (bar)", "cp1251"),
        ("Время (s);Давление (bar)", "koi8-r"),
        ("时间 (s);立压 (bar)", "gb18030"),
        ("时间 (s);泵压 (bar)", "gb18030"),
        ("Zeit (s);Standrohrdrück (bar)", "latin-1"),
    ],
)
def test_names_in_the_encoding_of_a_country_are_read_as_in_lists(tmp_path, names, encoding):
    path = tmp_path / "p.csv"
    path.write_bytes("\n".join(in_bar(names)).encode(encoding))
    assert_same(pressure_files.read(path))


def test_a_date_alone_may_hold_the_time_of_day_as_a_fraction(read):
    days = table("Date;SPP (Pa)", lambda _k, t, p: f"{46_082 + float(t) / 86_400:.11f};{p}".replace(".", ","))
    assert_same(read(days), 1e-5)


def test_a_column_without_times_and_with_its_unit_in_brackets_is_read(read):
    found = read(["SPP (Pa)", *(p for _, p in TEXTS)], columns="rate_hz=50")
    assert_same(found)


def test_of_several_pressures_the_second_gauge_is_the_next_best(read):
    assert read(FORMS["other pressures before the standpipe"], 2).pressure_pa[0] == 1.0


@pytest.mark.parametrize(
    ("head", "sound", "missing", "said"),
    [
        ("time_s,pressure_pa", "{t},{p}", "{t},Bad", "word in place of a number, such as 'Bad'"),
        ("time_s,pressure_pa", "{t},{p}", "{t},-999.25", "null value -999.25"),
        ("time_s,pressure_pa", "{t},{p}", "{t},", "not numbers"),
        # Not a finite number of pascal.
        ("time_s,pressure_bar", "{t},{p}e-5", "{t},1e308", ""),
        ("time_s,pressure_pa,Quality", "{t},{p},Good", "{t},{p},Bad [Configuration Error]", "bad quality"),
        ("time_s,pressure_pa,Quality", "{t},{p},192", "{t},{p},24", "bad quality"),
    ],
)
def test_a_row_without_a_sound_pressure_is_a_missing_sample(read, head, sound, missing, said):
    found = read(table(head, lambda k, t, p: (missing if k % 10 == 3 else sound).format(t=t, p=p)))
    kept = np.arange(COUNT) % 10 != 3
    np.testing.assert_allclose(found.time_s, TIME[kept], atol=1e-9)
    np.testing.assert_allclose(found.pressure_pa, PRESSURE[kept], rtol=1e-9)
    assert said in notes(found)


@pytest.mark.parametrize("first", [0, 17])
def test_samples_under_stamps_of_a_second_are_spread_evenly(read, first):
    found = read(table("Timestamp,SPP (Pa)", lambda k, _t, p: f"{1_772_000_000 + (k + first) // 50},{p}"))
    assert_same(found, 2e-3)
    assert "spread evenly" in notes(found)


@pytest.mark.parametrize("name", ["loop (mA)", "SPP 4-20 mA", "pressure 4 to 20 (bar)", "spp_ma"])
def test_a_current_loop_has_the_shape_of_the_pressure_and_a_broken_wire_is_missing(read, name):
    current = 4.0 + 16.0 * (PRESSURE - 1.9e7) / 2e6
    current[9] = 0.02
    found = read(table(f"time_s,{name}", lambda k, t, _p: f"{t},{current[k]:.6f}"))
    assert np.corrcoef(found.pressure_pa, np.delete(PRESSURE, 9))[0, 1] == pytest.approx(1.0, abs=1e-6)
    assert "4 to 20 mA" in notes(found)
    assert "broken wire" in notes(found)


@pytest.mark.parametrize(
    ("name", "signal", "full_pa"),
    [
        ("SPP 4-20 mA (0-350 bar)", (4.0, 20.0), 3.5e7),
        ("SPP (0-5,000 psi) 4-20mA", (4.0, 20.0), 5000 * 6894.757293168),
        ("SPP_4-20mA_(0-35_MPa)", (4.0, 20.0), 3.5e7),
        ("SPP 4..20 mA 0..250 kg/cm2", (4.0, 20.0), 250 * 98_066.5),
        ("P1 4 to 20 mA, 0 bar to 350 bar", (4.0, 20.0), 3.5e7),
        ("loop (mA) 400 barg", (4.0, 20.0), 4e7),
        ("SPP 0-20 mA (0-400 bar)", (0.0, 20.0), 4e7),
        ("SPP 1-5 V (0-35000 kPa)", (1.0, 5.0), 3.5e7),
        ("SPP 0-100 mV (0-350 bar)", (0.0, 100.0), 3.5e7),
    ],
)
def test_a_signal_is_scaled_by_the_range_of_the_gauge_in_the_name(read, name, signal, full_pa):
    """Below 1.9e7 Pa the pumps are off: a signal near the lower end is no failure of the gauge."""
    pressure = np.where(np.arange(COUNT) < 100, 0.0, PRESSURE)
    sent = signal[0] + (signal[1] - signal[0]) * pressure / full_pa
    found = read(table(f"time_s;{name}", lambda k, t, _p: f"{t};{sent[k]:.9f}"))
    np.testing.assert_allclose(found.pressure_pa, pressure, atol=100.0)
    assert "as the column is named" in notes(found)


def test_a_current_above_its_range_is_a_failed_gauge(read):
    current = 4.0 + 16.0 * PRESSURE / 3.5e7
    current[20:30] = 22.5
    found = read(table("time_s,SPP 4-20 mA (0-350 bar)", lambda k, t, _p: f"{t},{current[k]:.6f}"))
    np.testing.assert_allclose(found.pressure_pa, np.delete(PRESSURE, np.s_[20:30]), atol=100.0)
    assert "10 samples are above 21 mA" in notes(found)


def test_pressures_in_a_column_named_as_a_current_are_not_scaled_as_a_current(read):
    rows = table("time_s,SPP 4-20 mA (0-350 bar)", lambda k, t, _p: f"{t},{PRESSURE[k] / 1e5:.9f}")
    with pytest.raises(ValueError, match="pressure_bar="):
        read(rows)
    assert_same(read(rows, columns="time_s=1,pressure_bar=2"))


def in_bar(head):
    return table(head, lambda k, t, _p: f"{t};{PRESSURE[k] / 1e5:.6f}")


@pytest.mark.parametrize(
    ("lines", "question", "answer"),
    [
        (in_bar("")[1:], "--columns time_s=1,pressure_bar=2", "time_s=1,pressure_bar=2"),
        (in_bar("Zeitpunkt;Kanal 3"), "--columns", "time_s=Zeitpunkt,pressure_bar=Kanal 3"),
        (in_bar("time_s;Kanal 3"), "--columns", "pressure_bar=2"),
        (in_bar("time_s;SPP"), "--columns", "pressure_bar=SPP"),
        (table("time,SPP (Pa)", lambda k, _t, p: f"{20 * k},{p}"), "time_ms=time", "time_ms=time"),
        (table("Sample,SPP (Pa)", lambda k, _t, p: f"{k},{p}"), "rate_hz=50", "rate_hz=50"),
    ],
    ids=["no names", "other names", "no pressure", "no unit", "perhaps milliseconds", "no times"],
)
def test_what_a_table_does_not_say_is_asked_and_the_answer_is_taken(read, lines, question, answer):
    with pytest.raises(ValueError, match=question):
        read(lines)
    assert_same(read(lines, columns=answer))


@pytest.mark.parametrize("said", ["rate_hz=0", "decimal=komma", "decimal=", "decimal=.", "decimal_mark=comma"])
def test_an_answer_that_is_not_one_is_refused_with_those_that_are(read, said):
    with pytest.raises(ValueError, match="rate_hz" if "rate" in said else "decimal=comma or decimal=point"):
        read(PLAIN, columns=said)


def test_digits_that_may_be_thousands_are_decided_by_what_a_pressure_can_be_or_asked(read):
    bar, kilopascal = (
        table(f"Uhrzeit;SPP ({unit})", lambda k, _t, _p, whole=whole: f"12:00:{k / 50:06.3f};{whole},{100 + k}")
        for unit, whole in (("bar", 203), ("kPa", 20))
    )
    assert np.median(read(bar).pressure_pa) == pytest.approx(2.033e7, rel=1e-3)
    with pytest.raises(ValueError, match="decimal=comma"):
        read(kilopascal)
    assert np.median(read(kilopascal, columns="decimal=point").pressure_pa) == pytest.approx(2.03e7, rel=1e-2)


def set_back(seconds):
    return [(f"{float(t) + seconds * (float(t) < 3):.2f}", p) for t, p in TEXTS]


@pytest.mark.parametrize(
    ("rows", "note"),
    [
        (TEXTS[::-1], "falling order"),
        (TEXTS[50:100] + TEXTS[:50] + TEXTS[100:], "sorted"),
        ([*TEXTS[:9], TEXTS[10], TEXTS[9], *TEXTS[11:]], "sorted"),
        (set_back(3600), "set back 1 times, first by 3599.98 s"),
        (set_back(1), "set back"),
        ([row for row in TEXTS for _ in range(2)], "repeat"),
        (TEXTS[:150] + TEXTS[100:], "repeat"),
        (TEXTS + TEXTS, "repeat"),
        ([*TEXTS[:9], *TEXTS[3:]], "repeat"),
    ],
)
def test_rows_out_of_order_or_twice_and_a_clock_set_back_change_no_sample(read, rows, note):
    found = read(["time_s,pressure_pa", *(",".join(row) for row in rows)])
    assert_same(found)
    assert note in notes(found)


def test_a_las_of_times_and_a_spreadsheet_are_tables_too(read, tmp_path):
    head = "~V\n VERS. 2.0 :\n WRAP. NO :\n~W\n NULL. -999.25 :\n~C\n TIME.S : Time\n SPPA.PA : Standpipe\n~A"
    assert_same(read(table(head, lambda _k, t, p: f"{t} {p}"), name="p.las"))
    book = openpyxl.Workbook()
    for row in [("Time (s)", "SPP (Pa)"), *((float(t), float(p)) for t, p in TEXTS)]:
        book.active.append(row)
    book.save(tmp_path / "p.xlsx")
    assert_same(pressure_files.read(tmp_path / "p.xlsx"))


def test_strokes_are_read_by_the_same_rules(tmp_path):
    (tmp_path / "s.csv").write_text("Pump;Time (ms)\n1;500\n2;700\n1;1200\n")
    got = pressure_files.read_strokes(tmp_path / "s.csv")
    np.testing.assert_allclose(got[1], [0.5, 1.2])
    np.testing.assert_allclose(got[2], [0.7])


@pytest.mark.parametrize("said", ["comma", "Comma", "COMMA"])
def test_the_decimal_mark_is_said_in_any_case(read, said):
    lines = table("time_s;pressure_pa", lambda _k, t, p: f"{t};{p}".replace(".", ","))
    assert_same(read(lines, columns=f"decimal={said}"))


@given(st.floats(0.0, 90_000.0), st.floats(0.01, 0.5), st.booleans())
def test_seconds_without_a_unit_are_seconds(first, step, paused):
    """Also where they pause."""
    seconds = first + step * np.arange(2000) + 3000.0 * paused * (np.arange(2000) > 1000)
    np.testing.assert_allclose(table_times.of_numbers(seconds, ""), seconds)


def test_a_clock_that_falls_back_often_is_named():
    time, _, notes = table_times.in_order(np.tile(100.0 + STEP * np.arange(5), COUNT // 5))
    falls = int((np.diff(time) < 0.0).sum())
    assert (falls == 0 and notes) or f"fall back {falls} times" in notes[0]


VALUES = [float(f"{p / 1e5:.7f}") for p in PRESSURE]
ISO = TIMES["iso"][2]


def json_lines(sample):
    return "".join(json.dumps(sample(k)) + "\n" for k in range(COUNT))


JSON = {
    "an object a line": json_lines(lambda k: {"time_s": TIME[k], "pressure_bar": VALUES[k]}),
    "its last line lacks its end": json_lines(lambda k: {"t_s": TIME[k], "p_bar": VALUES[k]}) + '{"t_s": 60.0, "p_b',
    "a message of a broker": json_lines(lambda k: {"ts": ISO[k], "data": {"SPP": VALUES[k], "HKLD": 3}, "unit": "bar"}),
    "objects inside": json_lines(
        lambda k: {"time": ISO[k], "SPP": {"value": VALUES[k], "unit": "bar"}, "RPM": {"value": 1}}
    ),
    "a block of samples a line": "".join(
        json.dumps({"ts": 1_772_000_000 + k, "spp_bar": VALUES[50 * k : 50 * k + 50]}) + "\n"
        for k in range(COUNT // 50)
    ),
    "a row for each tag": json_lines(lambda k: {"time": ISO[k // 2 * 2], "tag": "HKLD", "value": 100.0})
    + json_lines(lambda k: {"time": ISO[k], "tag": "SPP", "value": VALUES[k], "unit": "bar"}),
    "a list": json.dumps([{"time_s": TIME[k], "pressure_bar": VALUES[k]} for k in range(COUNT)], indent=1),
    "a list that lacks its end": "[\n"
    + json_lines(lambda k: {"time_s": TIME[k], "pressure_bar": VALUES[k]}).replace("}", "},"),
    "a list for each quantity": json.dumps({"time_s": list(TIME), "pressure_bar": VALUES}),
    "names and rows": json.dumps(
        {"columns": ["time_s", "p_bar"], "data": list(map(list, zip(TIME, VALUES, strict=True)))}
    ),
    "samples with facts that hold for all": json.dumps(
        {"tag": "SPP", "unit": "bar", "samples": [{"timestamp": ISO[k], "value": VALUES[k]} for k in range(COUNT)]}
    ),
}


@pytest.mark.parametrize("form", JSON)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_the_same_pressure_in_any_json_is_the_same_samples(tmp_path, form, encoding):
    (tmp_path / "p.json").write_bytes(JSON[form].encode(encoding))
    assert_same(pressure_files.read(tmp_path / "p.json"), 2e-3)


def test_values_of_json_that_are_not_numbers_are_missing_samples(tmp_path):
    odd = {3: "Bad", 4: None, 5: -999.25, 6: float("nan"), 7: ""}
    text = json_lines(lambda k: {"time_s": TIME[k], "pressure_bar": odd.get(k % 10, VALUES[k])})
    (tmp_path / "p.json").write_text(text)
    kept = ~np.isin(np.arange(COUNT) % 10, list(odd))
    np.testing.assert_allclose(pressure_files.read(tmp_path / "p.json").time_s, TIME[kept], atol=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "[]",
        '{"time_s": 1}',
        "[" * 5000,
        "[" + '{"a":[' * 400 + "1" + "]}" * 400 + "]",
        '{"a":' * 5000,
        "[[[[1]]]]",
        '{"a": {"b": []}}\n',
    ],
)
def test_json_without_samples_is_refused_with_a_reason(tmp_path, text):
    (tmp_path / "p.json").write_text(text)
    with pytest.raises(ValueError, match=r"p\.json"):
        pressure_files.read(tmp_path / "p.json")


def test_one_column_is_not_both_time_and_pressure(tmp_path):
    (tmp_path / "one.csv").write_text("time_s-pressure_pa,other\n" + "".join(f"{k},{2e7 + k}\n" for k in range(40)))
    with pytest.raises(ValueError, match="time"):
        pressure_files.read(tmp_path / "one.csv")


@pytest.mark.parametrize("sample", [{"tag": "x" * 100_000, "value": 1}, {"tag": "c", "value": 1}])
def test_a_message_quotes_no_more_than_the_beginning_of_long_names(tmp_path, sample):
    (tmp_path / "p.json").write_text(json.dumps({"time": ISO[0], "tag": "b", "value": 1}) + "\n" + json.dumps(sample))
    with pytest.raises(ValueError, match=r"p\.json: no tag") as caught:
        pressure_files.read(tmp_path / "p.json")
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (json.dumps({f"a{k}": 1 for k in range(400)}) + "\n" + "{}\n" * 4000, "records"),
        (json.dumps({**{f"a{k}": 1 for k in range(400)}, "samples": [{}] * 4000}), "records"),
        (json.dumps({f"a{k}": 1 for k in range(501)}), "columns"),
        ('{"time_s": 1}\n' + json.dumps([{}] * 40_000), "bytes"),
    ],
)
def test_json_that_would_need_far_more_memory_than_its_size_is_refused_by_name(tmp_path, monkeypatch, text, what):
    budget = dataclasses.replace(budgets.PRESSURE_JSON, size=100_000, records=1_000_000)
    monkeypatch.setattr(budgets, "PRESSURE_JSON", budget)
    (tmp_path / "p.json").write_text(text)
    with pytest.raises(BudgetError, match=rf"p\.json: has .* {what}"):
        pressure_files.read(tmp_path / "p.json")


@settings(max_examples=settings().max_examples // 3)
@given(
    st.sampled_from(
        [
            ("RIG7.SPP", ["Time", "Tag", "Value", "Unit", "Quality"]),
            ("Stand Pipe Pressure (bar)", ["Timestamp", "TagName", "Value"]),
            ("rig/standpipe_pressure_bar", ["time", "topic", "value"]),
            ("PT-101", ["TimeStamp", "Point Name", "Data Value", "Engineering Units", "Status"]),
            ("SPP", ["Zeit", "Messstelle", "Wert", "Einheit", "Status"]),
        ]
    ),
    st.lists(st.sampled_from(["RIG7.HKLD", "Block.Position", "FT-100", "Choke Pressure"]), unique=True, max_size=3),
    st.sampled_from([",", ";", "\t"]),
    st.randoms(use_true_random=False),
    st.booleans(),
    st.booleans(),
)
def test_the_rows_of_the_pressure_in_an_export_of_several_tags_are_the_samples(
    tmp_path_factory, tag, others, separator, random, in_blocks, titled
):
    name, head = tag
    rows = []
    count = 100
    for k in range(count):
        for one in [*others, name]:
            value = f"{VALUES[k]:.7f}" if one == name else f"{100 + k % 7}"
            unit = "bar" if one in (name, "Choke Pressure") else "kN"
            rows.append([ISO[k], one, value, unit, "Good"][: len(head)])
    if in_blocks:
        tags = [*others, name]
        random.shuffle(tags)
        rows.sort(key=lambda row: tags.index(row[1]))
    lines = [*(["Export of a historian", ""] if titled else []), *(separator.join(row) for row in [head, *rows])]
    path = tmp_path_factory.mktemp("p") / "p.csv"
    path.write_text("\n".join(lines) + "\n")
    assert_same(pressure_files.read(path), count=count)


def test_a_tag_can_be_said_and_bad_values_of_a_tag_are_missing(read):
    rows = [f"{ISO[k]},{tag},{value},Good" for k in range(COUNT) for tag, value in (("A", 1), ("B", VALUES[k]))]
    rows[2 * 7 + 1] = f"{ISO[7]},B,7,Bad"
    named = ["Time,Tag,Value,Quality", *rows]
    with pytest.raises(ValueError, match="the tags are A, B"):
        read(named)
    np.testing.assert_allclose(read(named, columns="pressure_bar=B").pressure_pa, np.delete(PRESSURE, 7), rtol=1e-8)
    assert len(read(rows, columns="time=1,tag=2,value=3,pressure_bar=B").time_s) == COUNT
