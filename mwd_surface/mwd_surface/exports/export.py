# SPDX-License-Identifier: Apache-2.0
"""Writing of a survey list in any format; the formats have the same names in messages and in the CLI."""

from __future__ import annotations

import dataclasses
import difflib
import importlib
import re
import unicodedata
from pathlib import Path
from typing import TYPE_CHECKING

from mwd_sensors.core.foreign_text import not_a_file_name
from mwd_sensors.core.output_files import write_whole

if TYPE_CHECKING:
    from mwd_surface.exports.survey_table import SurveyTable


class ExportError(RuntimeError):
    """Raised if the file could not be written; the message gives the path and the reason."""


@dataclasses.dataclass(frozen=True)
class Format:
    """Format of a file."""

    ending: str
    word: str  #: word for the file name
    what: str  #: description of the format for people
    writer: tuple[str, str]  #: module and function that make the content
    of_well: bool = False  #: whether the function gets the columns and the head block in the display units of the well

    @property
    def is_report(self) -> bool:
        """Whether the file has the sections of the report."""
        return self.word == "report"

    def make(self, table: SurveyTable) -> bytes:
        """Return the bytes of the file."""
        module, function = self.writer
        # Import the module only now: listing the formats (command help, page) must be fast.
        write = getattr(importlib.import_module(f"mwd_surface.exports.{module}"), function)
        content: str | bytes = write(_in_units_of_the_well(table) if self.of_well else table)
        return content.encode() if isinstance(content, str) else content


def _in_units_of_the_well(table: SurveyTable) -> SurveyTable:
    """Return a table with its columns and head block in the display units and angle convention of its well."""
    from mwd_surface.exports.report_edge import Edge
    from mwd_surface.language.language import ENGLISH, language
    from mwd_surface.signals.units import FIELD

    display = table.surveys.well.display
    edge = Edge(language(ENGLISH), display.units == FIELD)
    header = tuple((label, edge.head(label, value)) for label, value in table.header)
    return dataclasses.replace(table.shown(display), header=header)


FORMATS: dict[str, Format] = {
    "html": Format(".html", "report", "survey report, HTML", ("report_html", "report_html")),
    "pdf": Format(".pdf", "report", "survey report, PDF", ("report_pdf", "report_pdf")),
    "csv": Format(".csv", "definitive", "definitive survey, CSV", ("csv_tables", "definitive_csv"), of_well=True),
    "raw_csv": Format(".csv", "raw", "every survey with six axes, CSV", ("csv_tables", "raw_csv_of"), of_well=True),
    "las": Format(".las", "definitive", "definitive survey, LAS 2.0", ("export_las", "las"), of_well=True),
    "deviation": Format(".csv", "deviation", "deviation from the design, CSV", ("csv_tables", "deviation_csv")),
    "dxf": Format(".dxf", "drawing", "plan and section, DXF", ("export_dxf", "dxf")),
    "xlsx": Format(".xlsx", "report", "survey report, workbook", ("export_xlsx", "xlsx")),
    "witsml": Format(
        ".xml", "trajectory", "definitive survey, WITSML 1.4.1.1", ("export_witsml", "witsml"), of_well=True
    ),
}


def export_file(table: SurveyTable, kind: str, folder: str | Path, name: str = "") -> Path:
    """
    Write one file, completely or not at all.

    Parameters
    ----------
    kind : str
        One of `FORMATS`.
    folder : path
        Folder of the file; created if missing.
    name : str
        File name without folder; invalid characters are replaced. Empty: well, word of the format and time of the
        table. If the name has no ending, the ending is added; for a format that is not the first with its ending in
        `FORMATS`, also the word of the format, so that two formats of one name are two files. An existing file is
        replaced.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    ValueError
        The format is unknown (the message names similar formats), the name is a path, or the content cannot be made,
        as in `report_pdf`.
    ExportError
        The folder or file cannot be written.
    """
    if kind not in FORMATS:
        near = difflib.get_close_matches(kind, FORMATS, n=2, cutoff=0.4) or list(FORMATS)
        raise ValueError(f"unknown format {kind!r}; did you mean {' or '.join(near)}?")
    made = FORMATS[kind]
    if wrong := not_a_file_name(name):
        raise ValueError(f"file name {name!r}: {wrong}")
    if name:
        first = next(key for key, other in FORMATS.items() if other.ending == made.ending)
        word = "" if name.endswith(made.ending) or kind == first else made.word
        stem = safe_name(*filter(None, (name.removesuffix(made.ending), word)))
    else:
        from mwd_surface.signals.cells import utc

        moment = utc(table.made_ns)[:19].replace(":", "").replace("-", "") + "Z"
        # Shorten a long name of the well, so that the word and the time remain in the file name.
        stem = safe_name(safe_name(table.surveys.well.wellbore_name, longest=48), made.word, moment)
    path = Path(folder) / (stem + made.ending)
    data = made.make(table)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, data)
    except OSError as error:
        raise ExportError(f"{path} could not be written: {error.strerror}") from error
    return path


LONGEST = 80  # largest number of bytes of a file name
# Names that Windows reserves, whatever the ending.
RESERVED = {"con", "prn", "aux", "nul", *(f"com{k}" for k in range(1, 10)), *(f"lpt{k}" for k in range(1, 10))}


def safe_name(*parts: str, longest: int = LONGEST) -> str:
    """
    Return one file name made of the parts, without folder and ending.

    Latin letters lose their diacritical marks (Å -> A). Letters and digits of other scripts are kept. Every other
    character except dot, minus and underscore becomes an underscore. The name is never empty, hidden, reserved or
    longer than `longest` bytes of UTF-8, because file systems limit the bytes of a name.
    """
    words = []
    for part in parts:
        letters = (letter for letter in unicodedata.normalize("NFKC", part) if not unicodedata.combining(letter))
        words.append(re.sub(r"[^\w.-]+", "_", "".join(map(_plain, letters))).strip("._-"))
    name = "-".join(w for w in words if w).encode()[:longest].decode(errors="ignore").strip("._-")
    if not name:
        return "unnamed"
    return f"_{name}" if name.split(".")[0].lower() in RESERVED else name


def _plain(letter: str) -> str:
    """Return a Latin letter without its diacritical marks; any other character unchanged."""
    bare = unicodedata.normalize("NFKD", letter)[0]
    return bare if bare.isascii() else letter
