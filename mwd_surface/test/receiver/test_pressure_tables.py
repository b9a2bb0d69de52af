# SPDX-License-Identifier: Apache-2.0
"""The same pressure in every table that rigs write is the same samples; what is not a number is a missing sample."""

import dataclasses
import datetime as dt
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_surface.receiver import pressure_files, table_times

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
    "clock with a colon": ("Uhrzeit", "", [f"{m:%H:%M:%S}:{m.microsecond // 1000:03d}" for m in moments()]),
    "compact iso": ("Timestamp", "", [f"{m:%Y%m%dT%H%M%S}.{m.microsecond // 1000:03d}Z" for m in moments()]),
    "month name": ("Time", "", [f"{m:%d-%b-%Y %H:%M:%S}.{m.microsecond // 1000:03d}" for m in moments()]),
    "short year": ("Time", "", [f"{m:%d/%m/%y %H:%M:%S}.{m.microsecond // 1000:03d}" for m in moments()]),
    "minutes and seconds": ("Elapsed", "", [f"{int(t // 60):02d}:{t % 60:05.2f}" for t in TIME]),
    "spreadsheet days": ("Date Time", "", [f"{46_082 + (86_397 + t) / 86_400:.11f}" for t in TIME]),
    "windows ticks": ("Timestamp", "", [f"{134_168_000_000_000_000 + round(1e7 * t)}" for t in TIME]),
    "hours": ("Elapsed time", "h", [f"{t / 3600:.9f}" for t in TIME]),
}
UNITS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": 6894.757293168}


def written(time, unit, separator=",", decimal=".", units="name", comments=(), head=()):
    name, time_unit, clock = TIMES[time]
    cells = [f"{p / UNITS[unit]:.9g}" for p in PRESSURE]
    rows = [
        [
            c if ":" in c or "T" in c else c.replace(".", decimal),
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
    assert_same(pressure_files.read(path), 1e-5)


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


@pytest.mark.parametrize(
    ("separator", "decimal", "thousands"), [(";", ",", "."), ("\t", ".", ","), (";", ",", "\u00a0"), ("\t", ".", "'")]
)
def test_a_mark_between_thousands_changes_no_number(tmp_path, separator, decimal, thousands):
    cells = [f"{p / 1e3:,.4f}".translate(str.maketrans({",": thousands, ".": decimal})) for p in PRESSURE]
    times = [f"{t:.2f}".replace(".", decimal) for t in TIME]
    rows = [f"{t}{separator}{c}" for t, c in zip(times, cells, strict=True)]
    (tmp_path / "p.txt").write_text("\n".join([f"Time (s){separator}SPP (kPa)", *rows]), encoding="utf-8")
    assert_same(pressure_files.read(tmp_path / "p.txt"))


def test_digits_that_may_be_thousands_are_decided_by_what_a_pressure_can_be_or_asked(tmp_path):
    (tmp_path / "p.csv").write_text(
        "\n".join(["Uhrzeit;SPP (bar)", *(f"12:00:{k / 50:06.3f};203,{100 + k}" for k in range(400))])
    )
    assert np.median(pressure_files.read(tmp_path / "p.csv").pressure_pa) == pytest.approx(2.033e7, rel=1e-3)
    (tmp_path / "p.csv").write_text(
        "\n".join(["Uhrzeit;SPP (kPa)", *(f"12:00:{k / 50:06.3f};20,{100 + k}" for k in range(400))])
    )
    with pytest.raises(ValueError, match="decimal=comma"):
        pressure_files.read(tmp_path / "p.csv")
    read = pressure_files.read(tmp_path / "p.csv", columns="decimal=point")
    assert np.median(read.pressure_pa) == pytest.approx(2.03e7, rel=1e-2)


ROWS = [(f"{t:.2f}", f"{p:.3f}") for t, p in zip(TIME, PRESSURE, strict=True)]


@pytest.mark.parametrize(
    ("rows", "note"),
    [
        (ROWS[::-1], "falling order"),
        (ROWS[100:200] + ROWS[:100] + ROWS[200:], "sorted"),
        ([*ROWS[:9], ROWS[10], ROWS[9], *ROWS[11:]], "sorted"),
        ([(f"{float(t) + 3600 * (float(t) < 3):.2f}", p) for t, p in ROWS], "set back 1 times, first by 3599.98 s"),
        ([(f"{float(t) + 1 * (float(t) < 3):.2f}", p) for t, p in ROWS], "set back"),
    ],
)
def test_the_order_of_the_rows_and_a_clock_set_back_lose_no_sample(tmp_path, rows, note):
    (tmp_path / "p.csv").write_text("\n".join(["time_s,pressure_pa", *(",".join(row) for row in rows)]))
    read = pressure_files.read(tmp_path / "p.csv")
    assert_same(read)
    assert note in " ".join(read.notes)


def test_an_offset_from_utc_counts(tmp_path):
    stamps = []
    for k, m in enumerate(moments()):
        hours = 2 if k < 200 else 1
        local = m + dt.timedelta(hours=hours)
        stamps.append(f"{local:%Y-%m-%d %H:%M:%S}.{m.microsecond // 1000:03d}+0{hours}:00")
    (tmp_path / "p.csv").write_text(
        "\n".join(["Time,SPP (Pa)", *(f"{t},{p}" for t, (_, p) in zip(stamps, ROWS, strict=True))])
    )
    assert_same(pressure_files.read(tmp_path / "p.csv"))


def test_a_date_and_a_clock_as_numbers_count(tmp_path):
    rows = [
        f"{m:%y%m%d},{int(f'{m:%H%M%S}')}.{m.microsecond // 1000:03d},{p}"
        for m, (_, p) in zip([one + dt.timedelta(seconds=3) for one in moments()], ROWS, strict=True)
    ]
    (tmp_path / "p.csv").write_text("\n".join(["DATE,TIME,SPPA (Pa)", *rows]))
    assert_same(pressure_files.read(tmp_path / "p.csv"))


def test_samples_of_bad_quality_are_missing(tmp_path):
    for good, bad in (("Good", "Bad [Configuration Error]"), ("192", "24")):
        rows = [f"{t},{p},{bad if k % 10 == 3 else good}" for k, (t, p) in enumerate(ROWS)]
        (tmp_path / "p.csv").write_text("\n".join(["time_s,pressure_pa,Quality", *rows]))
        read = pressure_files.read(tmp_path / "p.csv")
        np.testing.assert_allclose(read.time_s, TIME[np.arange(COUNT) % 10 != 3], atol=1e-9)
        assert "bad quality" in " ".join(read.notes)


def test_a_unit_in_the_cells_counts(tmp_path):
    rows = [f"{t:.2f} s,{p / 1e5:.6f} bar" for t, p in zip(TIME, PRESSURE, strict=True)]
    (tmp_path / "p.csv").write_text("\n".join(["Time,SPP", *rows]))
    assert_same(pressure_files.read(tmp_path / "p.csv"))


def test_the_standpipe_is_preferred_to_other_pressures(tmp_path):
    rows = [f"{t},9.1,1.0,{p},3.0" for t, p in ROWS]
    (tmp_path / "p.csv").write_text(
        "\n".join(["time_s,Diff Press (Pa),Pump Pressure (Pa),Stand Pipe Pressure (Pa),Hook load", *rows])
    )
    assert_same(pressure_files.read(tmp_path / "p.csv"))
    assert pressure_files.read(tmp_path / "p.csv", 2).pressure_pa[0] == 1.0


def test_rows_without_times_come_at_the_rate_said(tmp_path):
    (tmp_path / "p.csv").write_text("\n".join(["Sample,SPP (Pa)", *(f"{k},{p}" for k, (_, p) in enumerate(ROWS))]))
    with pytest.raises(ValueError, match="rate_hz=50"):
        pressure_files.read(tmp_path / "p.csv")
    assert_same(pressure_files.read(tmp_path / "p.csv", columns="rate_hz=50"))
    with pytest.raises(ValueError, match="rate_hz"):
        pressure_files.read(tmp_path / "p.csv", columns="rate_hz=0")


def test_a_las_of_times_and_a_spreadsheet_are_tables_too(tmp_path):
    import openpyxl

    head = "~V\n VERS. 2.0 :\n WRAP. NO :\n~W\n NULL. -999.25 :\n~C\n TIME.S : Time\n SPPA.PA : Standpipe\n~A\n"
    (tmp_path / "p.las").write_text(head + "\n".join(" ".join(row) for row in ROWS))
    assert_same(pressure_files.read(tmp_path / "p.las"))
    book = openpyxl.Workbook()
    for row in [("Time (s)", "SPP (Pa)"), *((float(t), float(p)) for t, p in ROWS)]:
        book.active.append(row)
    book.save(tmp_path / "p.xlsx")
    assert_same(pressure_files.read(tmp_path / "p.xlsx"))


def test_strokes_are_read_by_the_same_rules(tmp_path):
    (tmp_path / "s.csv").write_text("Pump;Time (ms)\n1;500\n2;700\n1;1200\n")
    got = pressure_files.read_strokes(tmp_path / "s.csv")
    np.testing.assert_allclose(got[1], [0.5, 1.2])
    np.testing.assert_allclose(got[2], [0.7])


@pytest.mark.parametrize("said", ["comma", "Comma", "COMMA"])
def test_the_decimal_mark_is_said_in_any_case_and_other_words_are_refused(tmp_path, said):
    rows = [f"{t};{p}".replace(".", ",") for t, p in ROWS]
    (tmp_path / "p.csv").write_text("\n".join(["time_s;pressure_pa", *rows]))
    assert_same(pressure_files.read(tmp_path / "p.csv", columns=f"decimal={said}"))
    for other in ("decimal=komma", "decimal=", "decimal=.", "decimal_mark=comma"):
        with pytest.raises(ValueError, match="decimal=comma or decimal=point"):
            pressure_files.read(tmp_path / "p.csv", columns=other)


@pytest.mark.parametrize("start", ["00:59:57", "23:59:57", "09:41:58", "12:00:57"])
@pytest.mark.parametrize("padded", [True, False])
@pytest.mark.parametrize("decimal", [".", ","])
def test_a_clock_in_digits_is_a_clock_without_a_date(tmp_path, start, padded, decimal):
    first = dt.datetime.fromisoformat(f"2026-03-01T{start}")
    cells = []
    for t in TIME:
        moment = first + dt.timedelta(seconds=float(t))
        digits = f"{moment:%H%M%S}" if padded else str(int(f"{moment:%H%M%S}"))
        cells.append(f"{digits}{decimal}{moment.microsecond // 10_000:02d}")
    rows = [f"{c};{p.replace('.', decimal)}" for c, (_, p) in zip(cells, ROWS, strict=True)]
    (tmp_path / "p.csv").write_text("\n".join(["TIME;SPPA (Pa)", *rows]))
    assert_same(pressure_files.read(tmp_path / "p.csv"))


@given(st.floats(0.0, 90_000.0), st.floats(0.01, 0.5), st.booleans())
def test_seconds_without_a_unit_are_seconds(first, step, paused):
    """Also where they pause."""
    seconds = first + step * np.arange(2000) + 3000.0 * paused * (np.arange(2000) > 1000)
    np.testing.assert_allclose(table_times.of_numbers(seconds, ""), seconds)


def test_a_clock_that_falls_back_often_is_named(tmp_path):
    rows = [f"{float(t) % 0.1 + 100.0:.2f},{p}" for t, p in ROWS]
    (tmp_path / "p.csv").write_text("\n".join(["time_s,pressure_pa", *rows]))
    time, _, notes = table_times.in_order(np.array([float(row.split(",")[0]) for row in rows]))
    falls = int((np.diff(time) < 0.0).sum())
    assert (falls == 0 and notes) or f"fall back {falls} times" in notes[0]


def test_a_pressure_too_large_for_a_number_of_pascal_is_a_missing_sample(tmp_path):
    rows = [f"{t},{'1e308' if k % 10 == 3 else p}" for k, (t, p) in enumerate(ROWS)]
    (tmp_path / "p.csv").write_text("\n".join(["time_s,pressure_bar", *rows]))
    read = pressure_files.read(tmp_path / "p.csv")
    assert np.isfinite(read.pressure_pa).all()
    assert len(read.time_s) == COUNT - COUNT // 10


VALUES = [float(f"{p / 1e5:.7f}") for p in PRESSURE]
ISO = TIMES["iso"][2]


def lines_of(sample):
    return "".join(json.dumps(sample(k)) + "\n" for k in range(COUNT))


JSON = {
    "an object a line": lines_of(lambda k: {"time_s": TIME[k], "pressure_bar": VALUES[k]}),
    "its last line lacks its end": lines_of(lambda k: {"t_s": TIME[k], "p_bar": VALUES[k]}) + '{"t_s": 60.0, "p_b',
    "a message of a broker": lines_of(lambda k: {"ts": ISO[k], "data": {"SPP": VALUES[k], "HKLD": 3}, "unit": "bar"}),
    "objects inside": lines_of(
        lambda k: {"time": ISO[k], "SPP": {"value": VALUES[k], "unit": "bar"}, "RPM": {"value": 1}}
    ),
    "a block of samples a line": "".join(
        json.dumps({"ts": 1_772_000_000 + k, "spp_bar": VALUES[50 * k : 50 * k + 50]}) + "\n"
        for k in range(COUNT // 50)
    ),
    "a row for each tag": lines_of(lambda k: {"time": ISO[k // 2 * 2], "tag": "HKLD", "value": 100.0})
    + lines_of(lambda k: {"time": ISO[k], "tag": "SPP", "value": VALUES[k], "unit": "bar"}),
    "a list": json.dumps([{"time_s": TIME[k], "pressure_bar": VALUES[k]} for k in range(COUNT)], indent=1),
    "a list that lacks its end": "[\n"
    + lines_of(lambda k: {"time_s": TIME[k], "pressure_bar": VALUES[k]}).replace("}", "},"),
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
    text = lines_of(lambda k: {"time_s": TIME[k], "pressure_bar": odd.get(k % 10, VALUES[k])})
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


@settings(max_examples=15)
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
    for k in range(COUNT):
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
    assert_same(pressure_files.read(path))


def test_a_tag_can_be_said_and_bad_values_of_a_tag_are_missing(tmp_path):
    rows = [
        f"{ISO[k]},{tag},{v},{q}" for k in range(COUNT) for tag, v, q in (("A", 1, "Good"), ("B", VALUES[k], "Good"))
    ]
    rows[2 * 7 + 1] = f"{ISO[7]},B,7,Bad"
    (tmp_path / "p.csv").write_text("\n".join(["Time,Tag,Value,Quality", *rows]))
    with pytest.raises(ValueError, match="the tags are A, B"):
        pressure_files.read(tmp_path / "p.csv")
    read = pressure_files.read(tmp_path / "p.csv", columns="pressure_bar=B")
    np.testing.assert_allclose(read.pressure_pa, np.delete(PRESSURE, 7), rtol=1e-8)
    (tmp_path / "p.csv").write_text("\n".join(rows))
    said = "time=1,tag=2,value=3,pressure_bar=B"
    assert len(pressure_files.read(tmp_path / "p.csv", columns=said).time_s) == COUNT


@pytest.mark.parametrize("names", ["Timestamp,HKLD (kN),Timestamp,SPP (Pa)", "HKLD Time,HKLD (kN),SPP Time,SPP (Pa)"])
def test_a_column_of_time_belongs_to_the_columns_after_it(tmp_path, names):
    rows = [f"{ISO[k + 9] if k < 200 else ''},{'7' if k < 200 else ''},{ISO[k]},{ROWS[k][1]}" for k in range(COUNT)]
    (tmp_path / "p.csv").write_text("\n".join([names, *rows]))
    assert_same(pressure_files.read(tmp_path / "p.csv"))


@pytest.mark.parametrize(
    "rows", [[row for row in ROWS for _ in range(2)], ROWS[:300] + ROWS[200:], ROWS + ROWS, [*ROWS[:9], *ROWS[3:]]]
)
def test_rows_that_are_there_twice_count_once(tmp_path, rows):
    (tmp_path / "p.csv").write_text("\n".join(["time_s,pressure_pa", *(",".join(row) for row in rows)]))
    read = pressure_files.read(tmp_path / "p.csv")
    assert_same(read)
    assert "repeat" in " ".join(read.notes)


@pytest.mark.parametrize("end", ["8.00,2", "8.0", "8.00,", "8"])
def test_a_last_line_without_its_end_is_left_out(tmp_path, end):
    (tmp_path / "p.csv").write_text("\n".join(["time_s,pressure_pa", *(",".join(row) for row in ROWS), end]))
    assert_same(pressure_files.read(tmp_path / "p.csv"))


@pytest.mark.parametrize(
    ("unit", "pascal"), [("ksi", 6_894_757.293168), ("psia", 6894.757293168), ("kgf/cm2", 98_066.5), ("hPa", 100.0)]
)
def test_other_units_of_pressure_are_read(tmp_path, unit, pascal):
    rows = [f"{t},{p / pascal:.12g}" for (t, _), p in zip(ROWS, PRESSURE, strict=True)]
    (tmp_path / "p.csv").write_text("\n".join([f"time_s,SPP ({unit})", *rows]))
    assert_same(pressure_files.read(tmp_path / "p.csv"))


@pytest.mark.parametrize(
    "head",
    [
        ["ETIM.S,SPPA.KPA"],
        ["Logger: 11", "Recorded: 03/01/2026 10:00:00", "", "Measurement time[s],SPP [kPa]"],
        ["Test time (s),Stand pipe (kPa)"],
    ],
)
def test_names_of_loggers_name_time_pressure_and_units(tmp_path, head):
    rows = [f"{t:.2f},{p / 1e3:.6f}" for t, p in zip(TIME, PRESSURE, strict=True)]
    (tmp_path / "p.csv").write_text("\n".join([*head, *rows]) + "\n")
    assert_same(pressure_files.read(tmp_path / "p.csv"), 1e-3)
