# SPDX-License-Identifier: Apache-2.0
"""Logs over depth as a WITSML 1.4.1.1 log object: one row per depth step, an empty field for an unknown value."""

from __future__ import annotations

from xml.sax.saxutils import escape, quoteattr

from mwd_surface.logs.depth_log import DepthLog
from mwd_surface.logs.log_files import LogColumn, columns, printed
from mwd_surface.signals.cells import plain
from mwd_surface.surveys.well import Well

_NAMESPACE = "http://www.witsml.org/schemas/1series"
# WITSML symbols of the units in which files are written; a quantity without unit has none.
_SYMBOLS = {"deg": "dega", "m/s^2": "m/s2", "rpm": "rpm", "C": "C", "gAPI": "gAPI"}


def witsml_log(log: DepthLog, which: str, well: Well) -> bytes:
    """Return one logging pass of a log (`which`, one of `PASSES`) as a WITSML document, UTF-8."""
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
