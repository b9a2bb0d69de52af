# SPDX-License-Identifier: Apache-2.0
"""
Remarks of a list: every assumption that its reader made and everything that the reader left out, each with a kind.

A remark is created together with its assumption and stays with the list: `StationList.remarks` becomes `Plan.remarks`
or `SurveyList.remarks`, which is kept in surveys.json and shown on the page, in the report, in exports and in clearance
results.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterable


class RemarkKind(enum.StrEnum):
    """Kind of a remark; the value of each member is the word written to files."""

    HOLE_ABOVE_ASSUMED = "hole_above_assumed"  #: the list begins below the wellhead; the path above is assumed
    TIE_ON_ASSUMED = "tie_on_assumed"  #: the path starts at a tie-on that is assumed
    TIE_ON_OF_LIST = "tie_on_of_list"  #: the path starts at the listed position of a first station below the wellhead
    TIE_ON_SHARP = "tie_on_sharp"  #: the hole turns implausibly between a given tie-on and the first station
    NOT_COMPARED = "not_compared"  #: a part of a well that was not compared in a clearance scan
    NORTH_ASSUMED = "north_assumed"  #: the list does not state from which north its azimuths are measured
    UNIT_ASSUMED = "unit_assumed"  #: a unit that the list does not state, or states in one place only
    NUMBERS_ASSUMED = "numbers_assumed"  #: a mark that may be the decimal mark or the thousands mark
    COLUMN_CHOSEN = "column_chosen"  #: several columns could be the quantity; one was chosen
    COLUMNS_EXCHANGED = "columns_exchanged"  #: inclination and azimuth look exchanged
    COLUMN_NOT_READ = "column_not_read"  #: a column, unit or word was not recognised; it is quoted
    DIP_CONVERTED = "dip_converted"  #: angles from the horizontal were converted to inclinations
    WELLHEAD_ASSUMED = "wellhead_assumed"  #: the position of the wellhead of an offset well is assumed
    MAP_SHIFTED = "map_shifted"  #: map coordinates; the wellhead was subtracted
    MAP_TURNED = "map_turned"  #: map coordinates turned from grid north to the north of the azimuths
    AZIMUTH_MISSING = "azimuth_missing"  #: stations without azimuth
    NULL_VALUES = "null_values"  #: cells with a null value, such as -999.25
    ROWS_LEFT_OUT = "rows_left_out"  #: rows that are not stations: nulls, footers, notes, repeated headers
    ROWS_REORDERED = "rows_reordered"  #: stations that were listed from the bottom up
    STATION_REPEATED = "station_repeated"  #: a station that occurs twice in the list
    STATIONS_NOT_USED = "stations_not_used"  #: stations whose verdict is not accept
    OVERRIDDEN = "overridden"  #: the caller replaced a unit or north that the file states
    TOOL_ASSUMED = "tool_assumed"  #: one tool code was used for a list that names several
    SPARSE = "sparse"  #: stations are so far apart that the hole between them is poorly known
    CONFIRMED = "confirmed"  #: an implausible value that the caller confirmed


@dataclasses.dataclass(frozen=True)
class Remark:
    """One remark on a list: an assumption of the reader, or something that the reader left out."""

    kind: RemarkKind
    text: str  #: a sentence for people that names the list
    #: numbers of the sentence by name, in SI and rad, finite
    values: dict[str, float] = dataclasses.field(default_factory=dict)


def distinct(remarks: Iterable[Remark]) -> tuple[Remark, ...]:
    """Return the remarks in their order without repeated sentences."""
    found: dict[str, Remark] = {}
    for remark in remarks:
        found.setdefault(remark.text, remark)
    return tuple(found.values())


def sentences(remarks: Iterable[Remark]) -> tuple[str, ...]:
    """Return the sentences of the remarks without repetition."""
    return tuple(remark.text for remark in distinct(remarks))
