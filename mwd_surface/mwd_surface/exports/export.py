"""Writes a survey list in any format; the formats have the same names in messages and in the CLI."""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import os
from collections.abc import Callable
from pathlib import Path

from mwd_surface.exports.export_csv import definitive_csv, raw_csv
from mwd_surface.exports.export_las import las
from mwd_surface.exports.export_name import safe_name
from mwd_surface.exports.export_witsml import witsml
from mwd_surface.exports.survey_table import SurveyTable, utc


class ExportError(RuntimeError):
    """The file could not be written; the message says where and why."""


@dataclasses.dataclass(frozen=True)
class Format:
    """Ending, a word for the name of the file, what it is for people, and the maker of its bytes."""

    ending: str
    word: str
    what: str
    make: Callable[[SurveyTable], bytes]


def _html(table: SurveyTable) -> bytes:
    # Drawing is slow to import; the other formats need none of it.
    from mwd_surface.exports.report_html import report_html

    return report_html(table).encode()


def _pdf(table: SurveyTable) -> bytes:
    from mwd_surface.exports.report_pdf import report_pdf

    return report_pdf(table)


FORMATS: dict[str, Format] = {
    "csv": Format(".csv", "definitive", "definitive survey, CSV", lambda t: definitive_csv(t).encode()),
    "raw_csv": Format(
        ".csv", "raw", "every survey taken with six axes, CSV", lambda t: raw_csv(t.surveys, t.header).encode()
    ),
    "las": Format(".las", "definitive", "definitive survey, LAS 2.0", lambda t: las(t).encode()),
    "witsml": Format(
        ".xml", "trajectory", "definitive survey, WITSML 1.4.1.1 trajectory", lambda t: witsml(t).encode()
    ),
    "html": Format(".html", "report", "survey report, one HTML file", _html),
    "pdf": Format(".pdf", "report", "survey report, PDF", _pdf),
}


def export(table: SurveyTable, kind: str, folder: str | Path, name: str = "") -> Path:
    """
    Write one file, whole or not at all.

    Parameters
    ----------
    table : SurveyTable
    kind : str
        One of `FORMATS`.
    folder : path
        Made where it is missing.
    name : str
        Of the file, without folder; made safe. Empty: well, word of the format and time of the table. A file of that
        name is replaced.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ValueError
        No such format, with the near ones.
    ExportError
        The folder or disk refuses.
    """
    if kind not in FORMATS:
        near = difflib.get_close_matches(kind, FORMATS, n=2, cutoff=0.4) or list(FORMATS)
        raise ValueError(f"format: no {kind!r}; did you mean {' or '.join(near)}?")
    made = FORMATS[kind]
    if name:
        stem = safe_name(name.removesuffix(made.ending))
    else:
        moment = utc(table.made_ns)[:19].replace(":", "").replace("-", "") + "Z"
        # The time and the word must survive a long name.
        stem = safe_name(safe_name(table.surveys.well.wellbore_name)[:48], made.word, moment)
    path = Path(folder) / (stem + made.ending)
    data = made.make(table)
    fresh = path.with_name(path.name + ".writing")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with fresh.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            fresh.unlink()
        raise ExportError(f"{path} not written: {error.strerror}") from error
    return path
