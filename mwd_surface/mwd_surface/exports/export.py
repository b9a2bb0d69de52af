# SPDX-License-Identifier: Apache-2.0
"""Writes a survey list in any format; the formats have the same names in messages and in the CLI."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from mwd_sensors.core.output_files import write_whole
from mwd_surface.exports.export_name import safe_name

if TYPE_CHECKING:
    from mwd_surface.exports.survey_table import SurveyTable


class ExportError(RuntimeError):
    """The file could not be written; the message says where and why."""


@dataclasses.dataclass(frozen=True)
class Format:
    """Ending, a word for the name of the file, what it is for people, and the maker of its bytes."""

    ending: str
    word: str
    what: str
    make: Callable[[SurveyTable], bytes]


# Each is imported when it is written: the command's help and the page list the formats and need none of them.


def _csv(table: SurveyTable) -> bytes:
    from mwd_surface.exports.export_csv import definitive_csv

    return definitive_csv(table).encode()


def _raw_csv(table: SurveyTable) -> bytes:
    from mwd_surface.exports.export_csv import raw_csv
    from mwd_surface.surveys.imported_list import provenance_of

    # The log has no row for the tie-on; its surveys are a path where all in use are of one leg.
    legs = {r.leg for r in table.surveys.records if r.in_use}
    provenance = provenance_of(table.surveys, legs.pop() if len(legs) == 1 else None, whole=False)
    return raw_csv(table.surveys, table.header, (*table.left_out, *table.remarks, *provenance.lines())).encode()


def _las(table: SurveyTable) -> bytes:
    from mwd_surface.exports.export_las import las

    return las(table).encode()


def _witsml(table: SurveyTable) -> bytes:
    from mwd_surface.exports.export_witsml import witsml

    return witsml(table).encode()


def _html(table: SurveyTable) -> bytes:
    from mwd_surface.exports.report_html import report_html

    return report_html(table).encode()


def _pdf(table: SurveyTable) -> bytes:
    from mwd_surface.exports.report_pdf import report_pdf

    return report_pdf(table)


FORMATS: dict[str, Format] = {
    "html": Format(".html", "report", "survey report, HTML", _html),
    "pdf": Format(".pdf", "report", "survey report, PDF", _pdf),
    "csv": Format(".csv", "definitive", "definitive survey, CSV", _csv),
    "raw_csv": Format(".csv", "raw", "every survey with six axes, CSV", _raw_csv),
    "las": Format(".las", "definitive", "definitive survey, LAS 2.0", _las),
    "witsml": Format(".xml", "trajectory", "definitive survey, WITSML 1.4.1.1", _witsml),
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
        Of the file, without folder; made safe. Empty: well, word of the format and time of the table. Without its
        ending the raw format gets its word too, so that two formats of one name are two files. A file of that name
        is replaced.

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
        first = next(key for key, other in FORMATS.items() if other.ending == made.ending)
        word = "" if name.endswith(made.ending) or kind == first else made.word
        stem = safe_name(*filter(None, (name.removesuffix(made.ending), word)))
    else:
        from mwd_surface.exports.survey_table import utc

        moment = utc(table.made_ns)[:19].replace(":", "").replace("-", "") + "Z"
        # The time and the word must survive a long name.
        stem = safe_name(safe_name(table.surveys.well.wellbore_name)[:48], made.word, moment)
    path = Path(folder) / (stem + made.ending)
    data = made.make(table)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, data)
    except OSError as error:
        raise ExportError(f"{path} not written: {error.strerror}") from error
    return path
