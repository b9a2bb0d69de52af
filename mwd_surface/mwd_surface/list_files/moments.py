# SPDX-License-Identifier: Apache-2.0
"""
Dates and clocks written in any usual way, as seconds.

A column is judged as a whole: the order of day and month follows from the dates that exist and from the shortest time
that they span.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mwd_sensors.core import utc
from mwd_sensors.core.arrays import Array

DAY_S = 86_400.0
_LATE_S = 600.0  # largest delay of a row relative to its neighbours, s
_DAY = (
    r"(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})"
    r"|(?P<cy>\d{4}|\d{2})(?P<cm>\d{2})(?P<cd>\d{2})"
    r"|(?P<a>\d{1,2})[-/.](?P<b>\d{1,2})[-/.](?P<z>\d{4}|\d{2})"
    r"|(?P<nd>\d{1,2})\.?[-/. ]?(?P<nm>\pL{3,9})\.?[-/., ]*(?P<ny>\d{4}|\d{2})"
    r"|(?P<um>\pL{3,9})\.? (?P<ud>\d{1,2}),? (?P<uy>\d{4})"
)
_CLOCK = (
    r"(?P<h>\d{1,4}):(?P<n>\d{2})(?::(?P<s>\d{2})(?:[.,:](?P<f>\d*))?)?\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
    r"|(?P<ch>\d{2})(?P<cn>\d{2})(?P<cs>\d{2})(?:[.,](?P<cf>\d*))?"
    r"|(?P<mm>\d{1,4}):(?P<ms>\d{2})[.,](?P<mf>\d+)"
)
_ZONE = r"\s?(?:Z|[A-Z]{3,4}|(?P<zs>[+-])(?P<zh>\d{2}):?(?P<zm>\d{2}))?"
_MOMENT = rf"^(?:(?:\pL{{2,9}}\.?,? )?(?:{_DAY})(?:[T ,;_]+|$))?(?:{_CLOCK})?{_ZONE}$"
# First letters of the months where German, French, Spanish and Norwegian differ from English.
_MONTHS = {
    **{dt.date(2000, k, 1).strftime("%b").lower(): k for k in range(1, 13)},
    **dict(zip(("mär", "mai", "okt", "dez", "des"), (3, 5, 10, 12, 12), strict=True)),
    **dict(zip(("fév", "avr", "aoû", "déc", "ene", "abr", "ago", "dic"), (2, 4, 8, 12, 1, 4, 8, 12), strict=True)),
    **dict(zip(("juin", "juil"), (6, 7), strict=True)),
}


def midnights(clock: Array, last: float = math.nan) -> Array:
    """
    Return the number of midnights between the first clock time and each clock time.

    A fall by more than half a day is a midnight; a rise by nearly a day is a late row of the previous day.

    Parameters
    ----------
    clock : ndarray, shape (n,)
        Seconds of the day; NaN where unknown.
    last : float
        Clock time before the first one; if given, midnights are counted from it.
    """
    known = np.flatnonzero(np.isfinite(clock))
    days = np.zeros(clock.size)
    if known.size:
        own = clock[known]
        steps = np.diff(own, prepend=own[0] if math.isnan(last) else last)
        days[known] = np.cumsum((steps < -0.5 * DAY_S).astype(float) - (steps > DAY_S - _LATE_S))
    return days


def of_text(text: Any) -> Array:
    """
    Return the times in a column of text (an Arrow array), s since 1970; NaN where a cell is neither date nor clock.

    Clocks without a date count from midnight, and continue after the next midnight. An offset from UTC in a cell is
    subtracted.
    """
    clock, ways = moments(text)
    order, _ = order_of(ways)
    return clock + DAY_S * (midnights(clock) if order is None else ways[order])


def moments(text: Any) -> tuple[Array, list[Array]]:
    """
    Return the seconds of the day of an Arrow array of text, and its days since 1970 in each order of day, month, year.

    Each array has the shape (n,), with NaN where a cell has no clock or no possible date.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    parts = pc.extract_regex(text, pattern=_MOMENT)

    def field(name: str) -> Any:
        return pc.struct_field(parts, name)

    def part(name: str) -> Array:
        one = field(name)
        return array(pc.cast(pc.if_else(pc.equal(one, ""), None, one), "float64"))

    def fraction(name: str) -> Array:
        one = pc.binary_join_element_wise("0.", field(name), "")
        return np.nan_to_num(array(pc.cast(one, "float64")))

    def month(name: str) -> Array:
        words = pc.utf8_lower(field(name))
        unique = [word for word in pc.unique(words).to_pylist() if word]
        numbers = [float(_MONTHS.get(word[:4], _MONTHS.get(word[:3], math.nan))) for word in unique]
        where = array(pc.cast(pc.index_in(words, pa.array(unique, pa.string())), "float64"))
        places = np.where(np.isfinite(where), where, len(unique)).astype(int)
        return np.asarray(np.array([*numbers, math.nan])[places])

    hour, minute, second = part("h"), part("n"), np.nan_to_num(part("s")) + fraction("f")
    half = pc.replace_substring(pc.utf8_lower(field("half")), ".", "")
    after, before = (array(pc.cast(pc.cast(pc.equal(half, word), "int8"), "float64")) for word in ("pm", "am"))
    hour = np.where(after == 1.0, hour % 12.0 + 12.0, np.where(before == 1.0, hour % 12.0, hour))
    clock = hour * 3600.0 + minute * 60.0 + second
    compact = part("ch") * 3600.0 + part("cn") * 60.0 + part("cs") + fraction("cf")
    short = part("mm") * 60.0 + part("ms") + fraction("mf")
    clock = np.where(np.isfinite(clock), clock, np.where(np.isfinite(compact), compact, short))
    zone = np.nan_to_num(part("zh") * 3600.0 + part("zm") * 60.0)
    clock -= np.where(array(pc.cast(pc.cast(pc.equal(field("zs"), "-"), "int8"), "float64")) == 1.0, -zone, zone)
    first, then, third = part("a"), part("b"), part("z")
    ways = [
        _days(*(part(name) for name in ("y", "m", "d"))),
        _days(*(part(name) for name in ("cy", "cm", "cd"))),
        _days(part("ny"), month("nm"), part("nd")),
        _days(part("uy"), month("um"), part("ud")),
        # Other orders of day, month and year. If several give valid dates, `order_of` chooses the one in which the file
        # spans the shortest time.
        _days(third, then, first),
        _days(third, first, then),
        _days(np.where(third < 100.0, first, math.nan), then, third),
    ]
    return clock, ways


def order_of(ways: list[Array]) -> tuple[int | None, bool]:
    """
    Return the index in `ways` of the order of day, month and year that fits, and whether no other order fits as well.

    Return None and True if there are no dates.
    """
    most = max(int(np.isfinite(days).sum()) for days in ways)
    if not most:
        return None, True
    spans = [float(np.nanmax(days) - np.nanmin(days)) if np.isfinite(days).sum() == most else math.inf for days in ways]
    return int(np.argmin(spans)), spans.count(min(spans)) == 1


def dated(days: Sequence[str], clocks: Sequence[str]) -> list[str]:
    """
    Return the times of a column of dates and a column of clocks as `iso_texts`; either may be empty texts.

    If the clocks contain dates, or the days do not, only the clocks are read.
    """
    # The clock of a spreadsheet's date is midnight.
    pairs = zip((day.removesuffix("T00:00:00") for day in days), clocks, strict=True)
    times = iso_texts([f"{day} {clock}".strip() for day, clock in pairs])
    return times if any(map(_is_iso, times)) else iso_texts(clocks)


def iso_texts(texts: Sequence[str]) -> list[str]:
    """
    Return the times of a column of text as ISO 8601, UTC if the texts name no zone.

    A text without a date stays as it is; so does the whole column if its dates fit two orders of day and month.
    """
    if all(not text or _is_iso(text) for text in texts):
        return list(texts)
    clock, ways = moments(text_array([text.strip() for text in texts]))
    order, sure = order_of(ways)
    if order is None or not sure:
        return list(texts)
    seconds = np.nan_to_num(clock) + DAY_S * ways[order]
    begin = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
    return [
        (begin + dt.timedelta(seconds=float(one))).isoformat() if math.isfinite(one) else text
        for one, text in zip(seconds, texts, strict=True)
    ]


def _is_iso(text: str) -> bool:
    try:
        utc.moment(text)
    except ValueError:
        return False
    return True


def text_array(cells: Sequence[str]) -> Any:
    """Return texts as an Arrow array."""
    import pyarrow as pa

    return pa.chunked_array([pa.array(cells, pa.string())])


def array(cells: Any) -> Array:
    """Return the numbers of an Arrow column; NaN for a null cell."""
    import pyarrow as pa

    # The conversion of Arrow would import pandas, which takes longer than reading an hour of pressure.
    parts = [np.zeros(0)]
    for chunk in cells.chunks if isinstance(cells, pa.ChunkedArray) else [cells]:
        part = slice(chunk.offset, chunk.offset + len(chunk))
        values = np.frombuffer(chunk.buffers()[1], dtype=float)[part]
        if chunk.null_count:
            valid = np.frombuffer(chunk.is_valid().cast("uint8").buffers()[1], dtype=np.uint8)[: len(chunk)]
            values = np.where(valid == 1, values, math.nan)
        parts.append(values)
    return np.concatenate(parts)


def _days(year: Array, month: Array, day: Array) -> Array:
    """Return days since 1970, NaN for an impossible date; years below 100 are years of this century."""
    good = np.isfinite(year) & (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
    year = np.where(year < 100.0, year + 2000.0, year)
    months = ((np.where(good, year, 1970.0) - 1970.0) * 12.0 + np.where(good, month, 1.0) - 1.0).astype("int64")
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(float) + np.where(good, day, 1.0) - 1.0
    return np.where(good, days, math.nan)
