# SPDX-License-Identifier: Apache-2.0
"""
Remarks of a list: every assumption that its reader made and everything that it left out, each with a kind.

A remark is made where the assumption is made and stays with the list: `StationList.remarks` becomes `Plan.remarks` or
`SurveyList.remarks`, which is kept in surveys.json and printed on the page, in the report, in exports and in clearance.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterable


class RemarkKind(enum.StrEnum):
    """Kind of an assumption; its value is the word in files."""

    HOLE_ABOVE_ASSUMED = "hole_above_assumed"  #: the list begins below the wellhead; the hole above is made up
    TIE_ON_ASSUMED = "tie_on_assumed"  #: the path starts at a tie-on that nobody gave
    TIE_ON_OF_LIST = "tie_on_of_list"  #: the path starts at depth, at the first station's own position
    NOT_COMPARED = "not_compared"  #: a part of a well that a clearance could not compare
    NORTH_ASSUMED = "north_assumed"  #: the list does not say from which north its azimuths are
    UNIT_ASSUMED = "unit_assumed"  #: a unit that the list does not say, or says in one place and not in another
    NUMBERS_ASSUMED = "numbers_assumed"  #: decimal or thousands mark that could also be read otherwise
    COLUMN_CHOSEN = "column_chosen"  #: one of several columns that could be the quantity
    COLUMN_NOT_READ = "column_not_read"  #: a column, unit or word that was not understood, quoted
    DIP_CONVERTED = "dip_converted"  #: angles from the horizontal turned into inclinations
    WELLHEAD_ASSUMED = "wellhead_assumed"  #: where the wellhead of an offset well lies
    MAP_SHIFTED = "map_shifted"  #: map coordinates; the wellhead was subtracted
    MAP_TURNED = "map_turned"  #: map coordinates turned from grid north to the north of the azimuths
    AZIMUTH_MISSING = "azimuth_missing"  #: stations without azimuth
    NULL_VALUES = "null_values"  #: cells with a null value, such as -999.25
    ROWS_LEFT_OUT = "rows_left_out"  #: rows that are not stations: nulls, footers, notes, repeated headers
    STATION_REPEATED = "station_repeated"  #: a station that stands twice in the list
    STATIONS_NOT_USED = "stations_not_used"  #: stations whose verdict is not accept
    OVERRIDDEN = "overridden"  #: a unit or north that the file states and the caller replaces
    TOOL_ASSUMED = "tool_assumed"  #: one tool code for a list that names several
    SPARSE = "sparse"  #: stations so far apart that the hole between them is hardly known
    CONFIRMED = "confirmed"  #: something implausible that the caller confirmed


@dataclasses.dataclass(frozen=True)
class Remark:
    """
    One assumption about a list.

    kind: what was assumed. text: a sentence for people, which names the list. values: numbers in it by name, SI and
    rad, finite.
    """

    kind: RemarkKind
    text: str
    values: dict[str, float] = dataclasses.field(default_factory=dict)


def distinct(remarks: Iterable[Remark]) -> tuple[Remark, ...]:
    """Return remarks in their order, those with the same sentence once."""
    found: dict[str, Remark] = {}
    for remark in remarks:
        found.setdefault(remark.text, remark)
    return tuple(found.values())


def sentences(remarks: Iterable[Remark]) -> tuple[str, ...]:
    """Return the sentences of remarks, each once."""
    return tuple(remark.text for remark in distinct(remarks))
