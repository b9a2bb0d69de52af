# SPDX-License-Identifier: Apache-2.0
"""
Reading of the head of a list: north, units, whether angles are measured from the horizontal, and the wellhead.

The head consists of the lines above the column names and of comments: "North Reference: Grid", "Depth Unit: ft",
"# WELL HEAD X-COORDINATE: 431200.000 (m)". A north or unit that is stated in unknown words is kept and quoted, never
treated as absent.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable, Mapping

from mwd_surface.list_files.list_columns import ANGLE_UNITS, LENGTH_UNITS, mentions_north, north_of, points, unit_word
from mwd_surface.list_files.number_cells import decimal_mark, split, value

_NORTH = re.compile(
    r"(?:(?:north|azimuths?|azi|azm|azim|bearing)[ _]*(?:angles?)?[ _]*(?:north)?[ _]*(?:ref(?:erence)?s?|type|datum)\b"
    r"|reference[ _]+north|north[ _]+type"
    r"|azimuths?[ _]+(?:are|is)?[ _]*(?:given|referenced|relative|measured|from|in)\b"
    r"|^\W*north\s*(?=[:=,;|\t])|北向|方位基准|方位参考|方位角类型|北参考"
    r"|nord[ -]?(?:refer\w*|richtung|bezug)|r[ée]f\w*\s+(?:du\s+)?nord|norte\s+de\s+ref\w*|referencia\s+(?:de\s+)?norte"
    r"|направлени[ея]\s+севера|^\W*север\b)"
    r"[^:=,;|\t]{0,40}?(?:[:=,;|\t]|\s)\s*(?P<said>.*)",
    re.IGNORECASE,
)
# Words that mark a line as a statement about azimuths, and words that show that a line is about something else.
_OF_AZIMUTHS = re.compile(
    r"azi|azm|\baz\b|bearing|(?:referenced|referred|corrected|relative)\s+to\b|方位|азимут|asimut|richtung",
    re.IGNORECASE,
)
_OF_OTHERS = re.compile(
    r"declin|conver|section|closure|field|model|coordinate|\bdip\b|wellhead|well head|slot|northing|easting|tool ?face|"
    r"target|[-=]>|磁偏角|收敛",
    re.IGNORECASE,
)
# Words of a sentence that states from which north azimuths are measured, or how they were corrected.
_SENTENCE = re.compile(
    r"azi\w*.*\b(?:corrected|uncorrected|referenced|referred|relative|measured|given|are|is|from)\b"
    r"|\b(?:corrected|uncorrected|referenced|referred)\b.*azi|方位.*(?:校正|修正|改正|未|不)",
    re.IGNORECASE,
)
_UNIT = re.compile(
    r"(?P<what>\b(?:depth|length|md|measured depth|distance|linear|angle|angular|inclination|azimuth|survey|unit|api)?)"
    r"\s*-?\s*units?(?:[ _]*(?:system|of measure|of length|of depth|set))?\s*(?:[:=,;|\t]|\bis\b)\s*(?P<said>.*)",
    re.IGNORECASE,
)
_IN_UNITS = re.compile(r"\b(?:in|IN)\s+(?P<said>[\w ]{1,20}?)-?\s*UNITS?\b", re.IGNORECASE)
_ANGLES_ARE = re.compile(
    r"\bangles?\b[^:=]*\b(?:in|are)\s+(?:given in\s+)?(?P<said>degrees|radians|grads?|gon)\b", re.IGNORECASE
)
_HORIZONTAL = re.compile(
    r"(?:incl\w*|dip|angle|倾角)[^:=]*\b(?:from|to|relative to|above|below|against)\s+(?:the\s+)?horizont|与水平面",
    re.IGNORECASE,
)
_POSITIVE = re.compile(r"\b(?:dips?|angles?|incl\w*)\b.*\bpositive|positive\s+dip|(?:倾|仰|俯).*正", re.IGNORECASE)
# Dips of the magnetic field or of beds, and single values such as "dip 62.5 deg", which are not angles of the hole. The
# values 0 and 90 are left out, because they may explain a convention.
_OTHER_DIP = re.compile(
    r"magn[eé]t|\bmag\b|\bmag[ _]?dip|\bm_?dip|\bfield|feld|\bb[ _]?(?:total|dip|field)|\b[nµμ]T\b|declin|\bref\b"
    r"|\breferences?\b(?!.*horizont)|\b(?:igrf|wmm|bggm|hdgm|mvhd|emm)|needle|magnit|магнит|磁|参考|基准"
    r"|\b(?:formation|bed|bedding|strat\w+|seam|layer|fault|reservoir|structural?)s?\b|地层|岩层|煤层|断层"
    r"|(?:\bdips?(?:[ _]angle)?|倾角)\W*(?!0\b|90\b)\d",
    re.IGNORECASE,
)
_OF_HOLE = re.compile(r"\b(?:bore)?holes?\b|\bcollar\b|\bwell(?:bore)?\b|钻孔|孔口|开孔", re.IGNORECASE)
_A_DIP = re.compile(r"\bdips?\b|incl|angle|倾|仰|俯", re.IGNORECASE)
# A part of a line that names something other than a vertical angle, such as "Tool: magnetic" or "Field: Alpha".
_NAMES_OTHERS = re.compile(
    rf"^\W*(?:field|tool|instrument|survey\w*|method)\b[^:=]*[:=]|\bnorth\b|北|{_OF_AZIMUTHS.pattern}", re.IGNORECASE
)
_HEAD_X = re.compile(
    r"(?:\b(?:well\s*-?\s*head|surface|slot|collar|well|head|wrp|location|top)\b|\+[NE]/-[SW])[^:=]*?"
    r"\b(?:x|east(?:ing)?s?)\b[^:=0-9]*[:=,;\t ]\s*"
    r"(?P<number>[-+]?\d[\d.,' ]*)\s*(?P<unit>\(?\s*[A-Za-z ]*\)?)",
    re.IGNORECASE,
)
_HEAD_Y = re.compile(_HEAD_X.pattern.replace(r"(?:x|east(?:ing)?s?)", r"(?:y|north(?:ing)?s?)"), re.IGNORECASE)
_IN_BRACKETS = re.compile(
    r"\b(?P<what>KB|RKB|DATUM|ELEVATION|COORDINATE|DEPTH|MD)\b.*?\d[^()]*\((?P<said>[A-Za-z ]+)\)", re.IGNORECASE
)
# Such lines are "Magnetic declination: 1.35 E" or "CONVERGENCE (deg) 0.7 West"; without a side, east is positive.
_ANGLE_TO_NORTH = re.compile(
    r"(?<![a-z])(?P<what>declination|convergence)(?:\s*angle)?\s*(?:[(\[]\s*(?:deg\w*|°)\s*[)\]]|,?\s*deg\w*|°)?\s*[:=]?"
    r"\s*(?P<number>[+-]?\d{1,3}(?:[.,]\d+)?)(?![\d.,/:-])\s*(?:°|deg(?:rees?|s)?\b)?\s*(?P<side>E(?:ast)?|W(?:est)?)?\b"
    r"(?!\s*(?:rad|gon|grad))",
    re.IGNORECASE,
)
# Petrel writes "DX DY ARE GIVEN IN GRID NORTH IN m-UNITS".
_OFFSETS = re.compile(r"\bDX\b.*\bDY\b", re.IGNORECASE)


@dataclasses.dataclass(frozen=True)
class Head:
    """Facts that the head of a list states."""

    north: str = ""  #: north of the azimuths, one of NORTHS; "" if not stated
    strange_north: str = ""  #: words for a north that were not recognised
    #: `length_unit`, `angle_unit`: as in LENGTH_UNITS and ANGLE_UNITS, or ""
    length_unit: str = ""
    angle_unit: str = ""
    strange_unit: str = ""  #: words for a unit that were not recognised
    map_unit: str = ""  #: unit of map coordinates and offsets
    #: unit of the elevation of the depth datum, such as the kelly bushing; depths usually have the same unit
    hinted_unit: str = ""
    horizontal: bool = False  #: whether angles are measured from the horizontal
    dip: str = ""  #: direction of positive angles from the horizontal, "up", "down" or ""
    wellhead: tuple[float, float] | None = None  #: northing and easting of the wellhead, m; None if not stated
    #: declination and convergence by these names, rad, east positive, if a line states them
    to_north: Mapping[str, float] = dataclasses.field(default_factory=dict)


def read_head(lines: Iterable[str]) -> Head:
    """
    Return the facts in the lines of a head; if two lines state the same fact, the last line counts.

    Sentences about azimuths that name different norths, or none that is recognised, are kept in `strange_north`.
    """
    head = Head()
    x = y = None
    told: dict[str, str] = {}  # north -> the line that names it
    strange: list[str] = []
    for line in lines:
        for part in (re.sub(r"\([^)]*\)", " ", line), *re.findall(r"\(([^)]*)\)", line)):
            if not _OF_AZIMUTHS.search(part):
                continue
            if named := north_of(part) if not _OF_OTHERS.search(part) else "":
                told[named] = line.strip()
            elif _SENTENCE.search(part) and mentions_north(part):
                # Quote a sentence about azimuths whose north is not recognised. Ignoring it would treat the north as
                # not stated.
                strange.append(line.strip())
        head = _units(_north(head, line), line)
        head = dataclasses.replace(head, to_north={**head.to_north, **_to_north(line)})
        if _tells_of_hole_angles(line):
            if _HORIZONTAL.search(line):
                head = dataclasses.replace(head, horizontal=True)
            if _POSITIVE.search(line):
                head = dataclasses.replace(head, dip=points(line) or head.dip)
        x, y = _coordinate(_HEAD_X, line) or x, _coordinate(_HEAD_Y, line) or y
        hinted = _IN_BRACKETS.search(line)
        if hinted and unit_word(hinted["said"]) in LENGTH_UNITS:
            unit = unit_word(hinted["said"])
            of_map = hinted["what"].upper() == "COORDINATE"
            head = dataclasses.replace(head, map_unit=unit) if of_map else dataclasses.replace(head, hinted_unit=unit)
    if x is not None and y is not None:
        head = dataclasses.replace(head, wellhead=(y, x))
    if not (head.north or head.strange_north) and told:
        # No line states the north in the form "name: value", but lines about azimuths name one.
        north = next(iter(told)) if len(told) == 1 else ""
        head = dataclasses.replace(head, north=north, strange_north="" if north else " / ".join(told.values()))
    elif not (head.north or head.strange_north) and strange:
        head = dataclasses.replace(head, strange_north=" / ".join(strange))
    return head


def _tells_of_hole_angles(line: str) -> bool:
    """Return false if the line contains a dip of the magnetic field or of beds, else true."""
    parts = re.split(r"[;,|\t，；。、]", line)
    rest = ", ".join(part for part in parts if _A_DIP.search(part) or not _NAMES_OTHERS.search(part))
    other = _OTHER_DIP.search(rest)
    # "Collar dip -60" and "hole dip 5" are values of the hole.
    return other is None or (other[0][-1].isdecimal() and bool(_OF_HOLE.search(rest)))


def _north(head: Head, line: str) -> Head:
    found = _NORTH.search(line)
    if found is None:
        return head
    said = re.split(r"[,;|\t]|\s{3,}", found["said"].strip())[0].strip(" .\"'")
    north = north_of(said) or north_of(line[found.start() :])
    if north:
        return dataclasses.replace(head, north=north, strange_north="")
    # Without a text after "Azimuth reference", the line has no value or is the name of a column.
    return dataclasses.replace(head, strange_north=said) if said and not head.north else head


def _to_north(line: str) -> dict[str, float]:
    """Return declination and convergence that a line states, rad, east positive."""
    stated = {}
    for found in _ANGLE_TO_NORTH.finditer(line):
        angle = float(found["number"].replace(",", "."))
        west = (found["side"] or "").upper().startswith("W")
        if abs(angle) <= 180.0 and not (west and angle < 0.0):
            stated[found["what"].lower()] = math.radians(-angle if west else angle)
    return stated


def _units(head: Head, line: str) -> Head:
    angles = _ANGLES_ARE.search(line)
    if angles and unit_word(angles["said"]) in ANGLE_UNITS:
        head = dataclasses.replace(head, angle_unit=unit_word(angles["said"]))
    found = _UNIT.search(line) or _IN_UNITS.search(line)
    if found is None:
        return head
    said = found["said"].strip(" ,;|\t.\"'")
    for part in (said, *re.split(r"[-,;/|\t]", said)):
        unit = unit_word(part)
        if unit in LENGTH_UNITS and _OFFSETS.search(line):
            return dataclasses.replace(head, map_unit=unit)
        if unit in LENGTH_UNITS:
            return dataclasses.replace(head, length_unit=unit, strange_unit="")
        if unit in ANGLE_UNITS:
            return dataclasses.replace(head, angle_unit=unit)
    words = {"metric": "m", "si": "m"}
    named = words.get(said.lower())
    if named:
        return dataclasses.replace(head, length_unit=named)
    depth = found.groupdict().get("what") or ""
    if said and depth.strip().lower() in ("depth", "length", "md", "measured depth") and not head.length_unit:
        return dataclasses.replace(head, strange_unit=said)
    return head


def _coordinate(pattern: re.Pattern[str], line: str) -> float | None:
    found = pattern.search(line)
    if found is None:
        return None
    number = split(found["number"].strip(" ,"))
    unit = unit_word(found["unit"])
    if number is None:
        return None
    try:
        return value(number[0], decimal_mark(number[0]) or ".") * LENGTH_UNITS.get(unit, 1.0)
    except ValueError:
        return None
