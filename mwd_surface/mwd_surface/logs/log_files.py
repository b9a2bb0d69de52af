# SPDX-License-Identifier: Apache-2.0
"""Logs over depth as files: LAS 2.0, CSV, Parquet and WITSML, with the same numbers in each."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry.log_channels import FROM_WORD, INCOMPLETE, ONE_SIDED, SATURATED
from mwd_surface.logs.depth_log import Curve, DepthLog, on_grid
from mwd_surface.signals.cells import fixed, plain
from mwd_surface.signals.units import UNITS
from mwd_surface.surveys.well import Well

NULL = -999.25  # number that stands for an unknown value in a LAS file
#: Mnemonics of curves in LAS that other programs know; any other channel has its name in capitals.
MNEMONICS = {"gamma": "GR", "inclination": "INCL", "temperature": "TEMP", "lateral_vibration": "VIBL"}
_DECIMALS = 3  # number of decimals in files
_NAMESPACE = "http://www.witsml.org/schemas/1series"
# WITSML symbols of the units in which files are written; a quantity without unit has none.
_SYMBOLS = {"deg": "dega", "m/s^2": "m/s2", "rpm": "rpm", "C": "C", "gAPI": "gAPI"}
_QUALITY = (
    f"sum of flags: {INCOMPLETE} little data, {SATURATED} detector saturated (lower bound), {FROM_WORD} from a word, "
    f"{ONE_SIDED} one side of the hole"
)


class LogColumn(NamedTuple):
    """Column of a log file: name in tables, mnemonic in LAS, unit for people, description, and values, shape (n,)."""

    key: str
    mnemonic: str
    unit: str
    description: str
    values: Array


def columns(log: DepthLog, which: str) -> list[LogColumn]:
    """
    Return the columns of a log: depth; and value, sigma, quality, time, counts and sectors of each channel.

    which: logging pass, one of `depth_log.PASSES`.
    """
    curves = [curve for curve in log.curves(which) if len(curve.depth)]
    depth, rows = on_grid(curves, log.step_m)
    found = [LogColumn("md_m", "DEPT", "m", "measured depth of the middle of the step", depth)]
    for curve, row in zip(curves, rows, strict=True):
        found += _columns_of(curve, row, len(depth))
    return found


def _columns_of(curve: Curve, rows: Array, count: int) -> list[LogColumn]:
    def spread(values: Array, factor: float = 1.0) -> Array:
        out = np.full(count, np.nan)
        out[rows] = values * factor
        return out

    scale = UNITS[curve.unit].people if curve.unit in UNITS else None
    unit = scale.symbol if scale is not None else curve.unit
    factor = scale.of(1.0) - scale.of(0.0) if scale is not None else 1.0
    offset = scale.of(0.0) if scale is not None else 0.0
    short = MNEMONICS.get(curve.channel, curve.channel.upper())
    key = curve.channel
    found = [
        LogColumn(key, short, unit, curve.channel, spread(curve.value, factor) + offset),
        LogColumn(f"{key}_sigma", f"{short}S", unit, f"1 sigma of {curve.channel}", spread(curve.sigma, factor)),
        LogColumn(f"{key}_quality", f"{short}Q", "", _QUALITY, spread(curve.quality)),
        LogColumn(f"{key}_seconds", f"{short}T", "s", f"time of measurement of {curve.channel}", spread(curve.seconds)),
    ]
    if np.isfinite(curve.counts).any():
        found.append(LogColumn(f"{key}_counts", f"{short}N", "", f"counts of {curve.channel}", spread(curve.counts)))
    for k in range(curve.sectors.shape[1]):
        where = f"{curve.channel}, sector {k + 1} of {curve.sectors.shape[1]} from the high side, clockwise"
        found.append(
            LogColumn(f"{key}_{k + 1}", f"{short}{k + 1:02d}", unit, where, spread(curve.sectors[:, k], factor))
        )
    return found


def csv(log: DepthLog, which: str, well: Well) -> bytes:
    """Return a CSV table, UTF-8, with one row for each depth step; unknown values are empty. `well` is not used."""
    del well
    found = columns(log, which)
    lines = [",".join(f"{one.key}{f'_{one.unit}' if one.unit and k else ''}" for k, one in enumerate(found))]
    lines += [",".join(fixed(float(one.values[k]), _DECIMALS) for one in found) for k in range(len(found[0].values))]
    return ("\n".join(lines) + "\n").encode()


def parquet(log: DepthLog, which: str, well: Well) -> bytes:
    """Return a Parquet file with the same numbers as the CSV table; unknown values are null. `well` is not used."""
    import pyarrow as arrow
    from pyarrow import parquet as files

    del well
    found = columns(log, which)
    table = arrow.table({one.key: arrow.array(printed(one.values), arrow.float64()) for one in found})
    out = io.BytesIO()
    files.write_table(table, out)
    return out.getvalue()


def las_of(well: Well) -> Any:
    """Return a LAS file (of lasio) without curves, with the names of a well and the number for unknown values."""
    import lasio

    file = lasio.LASFile()
    for mnemonic, value, descr in (
        ("WELL", well.name, "WELL"),
        ("COMP", well.company, "COMPANY"),
        ("FLD", well.field, "FIELD"),
        ("SRVC", well.service_company, "SERVICE COMPANY"),
    ):
        file.well[mnemonic] = lasio.HeaderItem(mnemonic, value=as_value(value), descr=descr)
    file.well["NULL"].value = NULL
    return file


def as_value(text: str) -> str:
    """Return a text on one line as a value for a LAS header line: a colon before a space becomes a comma."""
    # A colon before a space separates value and description in LAS, so replace it; a colon in a time remains.
    return re.sub(r"\s*:\s+", ", ", plain(text))


def las(log: DepthLog, which: str, well: Well) -> bytes:
    """Return a LAS 2.0 file; unknown values are -999.25."""
    from lasio import HeaderItem

    found = columns(log, which)
    file = las_of(well)
    file.params.append(HeaderItem("PASS", value=which, descr="PASS OF THE LOG, first, deepest or all"))
    for name, count in log.unplaced.items():
        file.params.append(
            HeaderItem(f"X{len(file.params):02d}", value=count, descr=f"SAMPLES OF {name} WITHOUT DEPTH")
        )
    file.other = "\n".join(gap_lines(log, which))
    for one in found:
        values = np.array([math.nan if v is None else v for v in printed(one.values)])
        file.append_curve(one.mnemonic, values, unit=one.unit.replace(" ", "").upper(), descr=one.description)
    text = io.StringIO()
    depth = found[0].values
    ends = {"STRT": depth[0], "STOP": depth[-1]} if len(depth) else {}
    file.write(text, version=2.0, fmt=f"%.{_DECIMALS}f", STEP=log.step_m, header_width=40, **ends)
    return text.getvalue().encode()


def witsml(log: DepthLog, which: str, well: Well) -> bytes:
    """Return a WITSML 1.4.1.1 log object, UTF-8: one row per depth step, an empty field for an unknown value."""
    found = columns(log, which)
    depth = found[0].values
    names = [f"<{tag}>{escape(plain(text)[:64])}</{tag}>" for tag, text in _head(well, which)]
    ends = []
    if len(depth):
        ends = [f'<startIndex uom="m">{depth[0]:.3f}</startIndex>', f'<endIndex uom="m">{depth[-1]:.3f}</endIndex>']
    curves = [_curve(column) for column in found]
    cells = [printed(column.values) for column in found]
    rows = [
        f"<data>{','.join('' if cell[k] is None else f'{cell[k]:.3f}' for cell in cells)}</data>"
        for k in range(len(depth))
    ]
    uids = (("uidWell", well.name), ("uidWellbore", well.wellbore_name), ("uid", f"mwd-{which}"))
    attributes = " ".join(f"{name}={quoteattr(plain(text)[:64])}" for name, text in uids)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<logs xmlns="{_NAMESPACE}" version="1.4.1.1">',
        f"<log {attributes}>",
        *names,
        "<indexType>measured depth</indexType>",
        *ends,
        "<direction>increasing</direction>",
        f"<indexCurve>{found[0].mnemonic}</indexCurve>",
        *curves,
        "<logData>",
        f"<mnemonicList>{','.join(column.mnemonic for column in found)}</mnemonicList>",
        f"<unitList>{','.join(_symbol(column) for column in found)}</unitList>",
        *rows,
        "</logData>",
        "</log>",
        "</logs>",
    ]
    return ("\n".join(lines) + "\n").encode()


def _head(well: Well, which: str) -> tuple[tuple[str, str], ...]:
    return ("nameWell", well.name), ("nameWellbore", well.wellbore_name), ("name", f"MWD log, {which} pass")


def _symbol(column: LogColumn) -> str:
    return _SYMBOLS.get(column.unit, column.unit) or "unitless"


def _curve(column: LogColumn) -> str:
    return (
        f'<logCurveInfo uid="{column.mnemonic}"><mnemonic>{column.mnemonic}</mnemonic>'
        f"<unit>{escape(_symbol(column))}</unit><curveDescription>{escape(column.description[:256])}</curveDescription>"
        "<typeLogData>double</typeLogData></logCurveInfo>"
    )


def gap_lines(log: DepthLog, which: str) -> list[str]:
    """Return one sentence for each channel with gaps."""
    return [_gap_line(curve) for curve in log.curves(which) if curve.gaps]


def _gap_line(curve: Curve) -> str:
    top, bottom = max(curve.gaps, key=lambda gap: gap[1] - gap[0])
    if len(curve.gaps) == 1:
        return f"{curve.channel}: no data from {top:.2f} to {bottom:.2f} m"
    total = math.fsum(end - begin for begin, end in curve.gaps)
    return (
        f"{curve.channel}: {len(curve.gaps)} gaps, {total:.2f} m together, the longest from {top:.2f} to {bottom:.2f} m"
    )


def printed(values: Sequence[float] | Array) -> list[float | None]:
    """Return numbers rounded as in files; None for unknown numbers."""
    cells = (fixed(float(value), _DECIMALS) for value in values)
    return [float(cell) if cell else None for cell in cells]


FORMATS: dict[str, Callable[[DepthLog, str, Well], bytes]] = {
    ".las": las,
    ".csv": csv,
    ".parquet": parquet,
    ".xml": witsml,
}
