# SPDX-License-Identifier: Apache-2.0
"""Read and convert UTC times as people write them in files."""

from __future__ import annotations

import datetime as dt
import re

_EPOCH = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
_MICROSECOND = dt.timedelta(microseconds=1)
_LEAP_SECOND = re.compile(r":59:60(?!\d)")


def moment(text: str) -> dt.datetime:
    """
    Parse a time written as ISO 8601, independent of the machine's time zone; a time without an offset is UTC.

    The leap second 23:59:60 is the second after 23:59:59, as in POSIX time (IEEE Std 1003.1, section 4.19).

    Raises
    ------
    ValueError
        The text is not a time, or the time is outside the years 1 to 9999.
    """
    plain, leaps = _LEAP_SECOND.subn(":59:59", text.strip())
    found = dt.datetime.fromisoformat(plain)
    try:
        return found.replace(tzinfo=found.tzinfo or dt.UTC).astimezone(dt.UTC) + dt.timedelta(seconds=leaps)
    except OverflowError as error:
        raise ValueError(f"{text!r} is not within the years 1 to 9999") from error


def stamp_ns(at: dt.datetime) -> int:
    """Return a time with a time zone as ns since 1970; the resolution of the type is 1 us."""
    return (at - _EPOCH) // _MICROSECOND * 1000
