# SPDX-License-Identifier: Apache-2.0
"""One list of stations written in many ways: separators, marks of numbers, encodings, units, names, kinds of file."""

import dataclasses
import io
import math

import numpy as np
import openpyxl

from mwd_sensors.core import minimum_curvature as mc

FEET = {"m": 1.0, "ft": 0.3048, "usft": 1200.0 / 3937.0}
SYMBOLS = {"m": "m", "ft": "ft", "usft": "ftUS"}
NAMES = {
    "english": ("Measured Depth", "Inclination", "Azimuth", "TVD", "+N/-S", "+E/-W"),
    "short": ("MD", "INC", "AZI", "TVD", "NS", "EW"),
    "chinese": ("孔深", "井斜角", "方位角", "垂深", "北位移", "东位移"),
    "german": ("Messteufe", "Neigung", "Azimut", "TVD", "North", "East"),
}
UNIT_WORDS = {
    "m": ("m", "metres", "m RKB", "mRKB"),
    "ft": ("ft", "feet", "ftKB", "ft RKB"),
    "usft": ("usft", "ftUS", "US survey feet", "US ft"),
}


@dataclasses.dataclass(frozen=True)
class Dialect:
    """How a list is written."""

    separator: str = ","
    decimal: str = "."
    thousands: str = ""
    encoding: str = "utf-8"
    unit: str = "m"
    unit_word: str = "m"
    degree: str = "deg"
    language: str = "english"
    positions: bool = True  #: whether vertical depth, north and east are in it
    empty_column: bool = False
    footer: bool = False
    page_break: bool = False
    head: bool = False
    newline: str = "\n"
    decimals: int = 4


def number(value, dialect, decimals=None):
    """A number as the dialect prints it."""
    text = f"{value:,.{dialect.decimals if decimals is None else decimals}f}"
    return text.translate(str.maketrans({",": dialect.thousands, ".": dialect.decimal}))


def header(dialect):
    length, angle = f" ({dialect.unit_word})", f" ({dialect.degree})"
    names = NAMES[dialect.language]
    units = (length, angle, angle, length, length, length)
    return [name + unit for name, unit in zip(names, units, strict=True)][: 6 if dialect.positions else 3]


def cells(stations, dialect):
    md, inc, azi = stations
    factor = FEET[dialect.unit]
    above = mc.path([0.0, md[0]], [0.0, inc[0]], [azi[0], azi[0]])[-1] if md[0] > 0.0 else (0.0, 0.0, 0.0)
    positions = mc.path(md, inc, azi, above)
    rows = []
    for k in range(len(md)):
        row = [md[k] / factor, math.degrees(inc[k]), math.degrees(azi[k])]
        if dialect.positions:
            row += [positions[k, axis] / factor for axis in (2, 0, 1)]
        rows.append([number(value, dialect) for value in row])
    return rows


def quoted(cell, separator):
    return f'"{cell}"' if separator in cell or '"' in cell else cell


def text(stations, dialect):
    """The list as bytes of a text file."""
    names, rows = header(dialect), cells(stations, dialect)
    grid = [names, *rows]
    if dialect.page_break and len(rows) > 3:
        grid[3:3] = [names]
    if dialect.empty_column:
        grid = [[row[0], "", *row[1:], ""] for row in grid]
    if dialect.head:
        grid = [["Company", "Example"], ["North Reference:", "Grid"], [], *grid]
    if dialect.footer:
        grid += [[], ["End of listing"], ["Total", "12 stations"]]
    if dialect.separator.isspace() and dialect.separator != "\t":
        lines = ["   ".join(f"{cell:>14}" for cell in row) for row in grid]
    else:
        lines = [dialect.separator.join(quoted(cell, dialect.separator) for cell in row) for row in grid]
    return (dialect.newline.join(lines) + dialect.newline).encode(dialect.encoding)


def angles(stations, dialect):
    """Rows of depth in the unit of the dialect, and inclination and azimuth in degrees."""
    md, inc, azi = stations
    return np.column_stack([np.asarray(md) / FEET[dialect.unit], np.degrees(inc), np.degrees(azi)]).tolist()


def spreadsheet(stations, dialect):
    """The list as bytes of an .xlsx file, numbers as numbers, with a title above and an empty first column."""
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["", "Survey listing"])
    sheet.append([])
    sheet.append(["", *header(dialect)[:3]])
    for row in angles(stations, dialect):
        sheet.append([None, *row])
    sheet.append([None, "End of listing"])
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


def las(stations, dialect, version=2):
    """The list as LAS 2.0, or as the section ~Inclinometry of LAS 3.0."""
    rows, unit = angles(stations, dialect), SYMBOLS[dialect.unit].upper()
    names = f" MD.{unit} : Measured depth {{F}}\n DEVI.DEG : Deviation {{F}}\n AZIM.DEG : Azimuth {{F}}\n"
    start = f"~Version\n VERS. {version}.0 :\n WRAP. NO :\n"
    if version == 2:
        data = "".join(" ".join(f"{v:.6f}" for v in row) + "\n" for row in rows)
        return f"{start}~Well\n NULL. -999.25 :\n~Curve\n{names}~A\n{data}".encode()
    data = "".join(",".join(f"{v:.6f}" for v in row) + "\n" for row in rows)
    return (
        f"{start} DLM. COMMA :\n~Well\n NULL. -999.25 : NULL\n~Inclinometry_Parameter\n I_AT. GRID : "
        "Azimuth North Type\n"
        f"~Inclinometry_Definition\n{names}~Inclinometry_Data | Inclinometry_Definition\n{data}"
    ).encode()


def witsml(stations, dialect, version="1.4.1.1"):
    """The list as a WITSML trajectory of a version."""
    unit = SYMBOLS[dialect.unit]
    spaces = {
        "1.3.1.1": "http://www.witsml.org/schemas/131",
        "1.4.1.1": "http://www.witsml.org/schemas/1series",
        "2.0": "http://www.energistics.org/energyml/data/witsmlv2",
        "2.1": "http://www.energistics.org/energyml/data/witsmlv2",
    }
    old = version.startswith("1")
    tags = ("md", "incl", "azi", "trajectoryStation") if old else ("MD", "Incl", "Azi", "TrajectoryStation")
    degree = "dega" if old else "deg"
    rows = ""
    for m, i, a in angles(stations, dialect):
        depth = f'<{tags[0]} uom="{unit}">{m:.6f}</{tags[0]}>'
        if version == "2.1":
            depth = f'<MD><MeasuredDepth uom="{unit}">{m:.6f}</MeasuredDepth></MD>'
        rows += (
            f'<{tags[3]}>{depth}<{tags[1]} uom="{degree}">{i:.6f}</{tags[1]}>'
            f'<{tags[2]} uom="{degree}">{a:.6f}</{tags[2]}></{tags[3]}>\n'
        )
    if old:
        return (
            f'<?xml version="1.0" encoding="UTF-8"?>\n<trajectorys xmlns="{spaces[version]}" version="{version}">'
            f"<trajectory><nameWell>w</nameWell><name>x</name><aziRef>grid north</aziRef>{rows}</trajectory>"
            "</trajectorys>"
        ).encode()
    return (
        f'<Trajectory xmlns="{spaces[version]}" schemaVersion="{version}"><Citation><Title>x</Title></Citation>'
        f"<AziRef>grid north</AziRef>{rows}</Trajectory>"
    ).encode()


def p7(stations, dialect):
    """The list as IOGP P7/17."""
    unit = SYMBOLS[dialect.unit]
    rows = "".join(
        f"P7,0,1,1,,,,D,1,Surveyed,{m:.6f},{i:.6f},{a:.6f},,,,,,,,\n" for m, i, a in angles(stations, dialect)
    )
    return (
        "IOGP,Example,7,1.0,1,2026:03:01,12:00:00,example.p717,us\n"
        f"H7,1,5,0,Survey Definition,1,1,1,MWD,Magnetic,,,,,0,1000,{unit},2026:03:01,,,,,\n"
        "H7,1,5,1,Survey Details,1,5,2,MD,1,Indicated depth,1,9,AZ_GRID,4,Calculated,1,1.78,0,,,,\n" + rows
    ).encode()
