# SPDX-License-Identifier: Apache-2.0
"""
Surveys as CSV: the definitive survey of a leg, and every survey of the list, each with a head block.

Lines starting with # are the head block. One line of column names with units and the rows follow; numbers have a
decimal point in every locale (`surveys.survey_csv`).
"""

from __future__ import annotations

from collections.abc import Iterable

from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals.cells import plain
from mwd_surface.surveys import survey_csv
from mwd_surface.surveys.imported_list import provenance_of
from mwd_surface.surveys.survey_list import SurveyList


def definitive_csv(table: SurveyTable) -> str:
    """
    Return the definitive survey: head block, column names, one line per station; the projection to the bit is last.

    The column `station` gives the kind of station: tie-on, assumed (assumed tie-on, because none was given), survey,
    projected. The column `coordinates` is "assumed" if depths and positions are based on an assumption; the head block
    names the assumption.

    Text is UTF-8 when encoded; lines end with a newline.
    """
    head = [f"# {label}: {value}" for label, value in table.header]
    head += [f"# {why}" for why in (*table.left_out, *map(plain, table.remarks))]
    head += [f"# {line}" for line in provenance_of(table.surveys, table.path.leg).lines()]
    path, north = table.path, table.surveys.north
    lines = []
    for k in table.rows:
        record = table.records[k]
        known = {"leg": path.leg} if record is None else survey_csv.cells(record, north, table.display)
        placed = {column.key: column.cell(k) for column in table.columns}
        named = {"azimuth_reference": path.north.name.lower(), "station": path.kind[k]}
        lines.append({**known, **placed, **named, "coordinates": "assumed" if path.assumed else ""})
    return "".join(f"{line}\n" for line in head) + survey_csv.text(lines, display=table.display)


def raw_csv_of(table: SurveyTable) -> str:
    """Return all surveys of the list of a table below its head block, with the table's sentences as comments."""
    # The raw list has no row for the tie-on. Its surveys form one path only if all surveys in use belong to one leg.
    legs = {r.leg for r in table.surveys.records if r.in_use}
    provenance = provenance_of(table.surveys, legs.pop() if len(legs) == 1 else None, whole=False)
    return raw_csv(table.surveys, table.header, (*table.left_out, *table.remarks, *provenance.lines()))


def raw_csv(surveys: SurveyList, header: Iterable[tuple[str, str]] = (), notes: Iterable[str] = ()) -> str:
    """
    Return all surveys of the list in order of number, in use or not; azimuths are from each survey's own north.

    header, notes: labels and values of the head block, and comment lines below this block.
    """
    head = [f"# {label}: {value}" for label, value in header] + [f"# {plain(note)}" for note in notes]
    lines = survey_csv.list_cells(surveys, surveys.well.display)
    return "".join(f"{line}\n" for line in head) + survey_csv.text(lines, display=surveys.well.display)
