# SPDX-License-Identifier: Apache-2.0
"""
Signal table, `table.csv`: every quantity once, with its name on the page and in each protocol and file.

The table defines WITS items, Modbus registers, OPC UA variables, the D-WIS manifest, columns of surveys in CSV,
Parquet, LAS, WITSML and on paper, columns of attitude and recordings in CSV and Parquet, live quantities of the page,
and the documentation page of signals. The D-WIS nouns are those of the DDHub vocabulary (definition sets
DrillingDataSemantics, PhysicalLocation and Uncertainty). The vocabulary has no noun for a toolface, gravity or a
magnetic field; the rows of these quantities name only the kind of data.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

from mwd_surface.signals.signal import (
    ADVICE,
    CONTROL,
    LOG,
    PLAN,
    SOURCES,
    SURFACE,
    SURVEY,
    FileColumn,
    Listed,
    Shown,
    Signal,
    Wits,
)

FILE = Path(__file__).with_name("table.csv")


def read_signals(path: Path = FILE) -> tuple[Signal, ...]:
    """
    Return the signals of a table, in its order.

    Raises
    ------
    ValueError
        A row is not a valid signal; the message names the signal.
    """
    with path.open(encoding="utf-8", newline="") as file:
        return tuple(_signal(row) for row in csv.DictReader(file, strict=True))


def page_fields(section: str) -> dict[str, Signal]:
    """Return the signals of a section of the page, by their names in this section."""
    places = ((place.partition("."), signal) for signal in SIGNALS for place in signal.page)
    return {name: signal for (part, _, name), signal in places if part == section}


def _signal(row: Mapping[str, str]) -> Signal:
    page = tuple(row["page"].split())
    try:
        code, _, wits = row["wits"].partition(" ")
        name, _, decimals = wits.partition(" ")
        return Signal(
            name=row["name"],
            unit=row["unit"],
            meaning=row["meaning"],
            source=row["source"],
            type=row["type"],
            circle=_flag(row["circle"]),
            sigma=_flag(row["sigma"]),
            doubts=tuple(row["doubts"].split()),
            field=row["field"] or (page[0].rpartition(".")[2] if page else ""),
            page=page,
            shown=Shown(*map(int, row["shown"].split())) if row["shown"] else None,
            opcua=row["opcua"],
            dwis=tuple(row["dwis"].split()),
            modbus=int(row["modbus"]) if row["modbus"] else None,
            wits=Wits(int(code), name.replace("-", ""), int(decimals)) if code else None,
            reads=int(row["reads"]) if row["reads"] else None,
            record=row["record"],
            listed=Listed(*_column(row["list"]), row["title"], row["las"], row["witsml"]) if row["list"] else None,
            series=_column(row["series"]) if row["series"] else None,
            attitude=_column(row["attitude"]) if row["attitude"] else None,
        )
    except (AttributeError, ValueError) as error:
        raise ValueError(f"{FILE.name}, signal {row['name']}: {error}") from error


def _column(text: str) -> FileColumn:
    key, _, decimals = text.partition(" ")
    return FileColumn(key, int(decimals or 0))


def _flag(text: str) -> bool:
    if text not in ("", "yes"):
        raise ValueError(f"expected yes or nothing, got {text!r}")
    return bool(text)


SIGNALS = read_signals()
BY_NAME = {signal.name: signal for signal in SIGNALS}
# Signals that are sent to a rig (all of them by OPC UA), and signals about the surface node itself.
TO_RIG = tuple(signal for signal in SIGNALS if signal.opcua and signal.source != SURFACE)
FACTS = tuple(signal for signal in SIGNALS if signal.source == SURFACE)
OF_SURVEY = tuple(signal for signal in TO_RIG if signal.source == SURVEY)
FROM_TOOL = tuple(signal for signal in TO_RIG if SOURCES[signal.source].tool)
FROM_PLAN = tuple(signal for signal in TO_RIG if signal.source == PLAN)
FROM_CONTROL = tuple(signal for signal in TO_RIG if signal.source == CONTROL)
FROM_LOG = tuple(signal for signal in TO_RIG if signal.source == LOG)
FROM_ADVICE = tuple(signal for signal in TO_RIG if signal.source == ADVICE)
# Signal and column, in order, for tables of surveys; for each export of the definitive survey; and for time series of
# recordings.
SURVEY_TABLE = tuple((signal, signal.listed) for signal in SIGNALS if signal.listed is not None)
LISTED = tuple((signal, listed) for signal, listed in SURVEY_TABLE if listed.las)
SERIES = tuple((signal, signal.series) for signal in SIGNALS if signal.series is not None)
ATTITUDE = tuple((signal, signal.attitude) for signal in SIGNALS if signal.attitude is not None)
