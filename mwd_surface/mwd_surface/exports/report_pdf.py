# SPDX-License-Identifier: Apache-2.0
"""The survey report as PDF: A4 landscape, numbered pages, head block, certificate, tables and figures."""

from __future__ import annotations

import contextlib
import datetime as dt
import io
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from mwd_surface.exports.report_content import Content, content, printed_logo
from mwd_surface.exports.report_edge import for_people
from mwd_surface.exports.report_section import TINTS, Drawing, Section, Sheet
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.language.language import language
from mwd_surface.plots import drawing

if TYPE_CHECKING:
    from fpdf.fonts import FontFace
    from matplotlib.figure import Figure

_FONT, _SPARE = "text", "spare"
_GAP = 18.0  # distance between two signatures, mm
_CERTIFICATE = 28.0  # height of the certificate with its signatures, mm
_MARK = (255, 243, 224)  # colour of a highlighted row, RGB
_STROKE = 0.03  # width of the outline that makes a text bold without a bold font, as a share of the font size
# Heights, mm: title at the top of a page, heading of a section, caption of a drawing.
_TITLE, _HEADING, _CAPTION = 5.0, 8.0, 6.0
# Heights, mm: heading of a table, and the part of a table that is kept on the page of its heading (two lines of titles
# and three rows).
_SHEET, _BEGINNING = 7.0, 21.0
# Heights of the rows of a table, mm: the usual height, then heights tried in turn if few rows would be alone on the
# last page.
_ROWS = (4.2, 4.0, 3.7, 4.6, 5.0, 5.4)
_ALONE = 12  # largest number of rows that count as few
_SMALLER = 0.6  # smallest scale to which a drawing is reduced to keep it on the page of its heading
_SENTENCE = 9.2  # height of a sentence of two lines, mm
_NARROW = 134.0  # width of one of two drawings side by side, mm


def report_pdf(table: SurveyTable) -> bytes:
    """
    Return the report of a table as the bytes of a PDF file; the same table gives the same text.

    Raises
    ------
    ValueError
        The language is unknown, or no font here has its characters.
    """
    from fpdf import FPDF

    well = table.surveys.well
    said = language(well.language)
    report = for_people(content(table), said, well.units)
    title = report.title
    if without := drawing.lacking((report.certificate,)):
        raise ValueError(f"well.language: no font has the characters {without[:20]} of the report: {drawing.HOW}")

    # The font with Chinese characters has only a regular weight: bold texts get thicker outlines.
    wide = drawing.needs_wide(report.words())

    class Page(FPDF):  # type: ignore[misc]
        """Pages with the title and the page number."""

        @contextlib.contextmanager
        def use_font_face(self, font_face: FontFace) -> Iterator[None]:
            """Print with a font face; thicken the strokes for bold if the font has no bold weight."""
            with contextlib.ExitStack() as stack:
                if wide and font_face and font_face.emphasis:
                    width = _STROKE * (font_face.size_pt or self.font_size_pt) / self.k
                    stack.enter_context(self.local_context(text_mode="FILL_STROKE", line_width=width, draw_color=0))
                stack.enter_context(super().use_font_face(font_face))
                yield

        def header(self) -> None:
            if self.page_no() > 1:
                self.set_font(_FONT, "", 8)
                self.cell(0, _TITLE, title, new_x="LMARGIN", new_y="NEXT")

        def footer(self) -> None:
            self.set_y(-10)
            self.set_font(_FONT, "", 8)
            self.cell(0, 5, said.say(f"page {self.page_no()} of {{nb}}"), align="R")

    pdf = Page(orientation="landscape", format="A4")
    main, bold = drawing.main_font(), drawing.main_font(bold=True)
    if wide:
        # Use one font for all texts: fpdf2 2.8 prints wrong glyphs if the font changes within a cell of two lines.
        first, *others = drawing.wide_fonts()
        spares = {f"{_SPARE}{k}": path for k, path in enumerate((main, *others))}
        for name, path in spares.items():
            pdf.add_font(name, "", path)
        pdf.set_fallback_fonts([*spares], exact_match=False)
        main = bold = first
    pdf.add_font(_FONT, "", main)
    pdf.add_font(_FONT, "B", bold)
    pdf.set_creation_date(dt.datetime.fromtimestamp(table.made_ns // 10**9, tz=dt.UTC))
    pdf.set_title(title)
    pdf.set_author(well.service_company)
    pdf.set_subject(" ".join(filter(None, (well.company, well.field, well.wellbore_name, well.job_number))))
    pdf.set_keywords(" ".join(filter(None, (well.rig, well.revision))))
    pdf.set_creator(dict(table.header).get("Software", "mwd"))
    pdf.set_lang(said.code.replace("_", "-"))
    pdf.set_margins(10, 10)
    pdf.set_auto_page_break(True, margin=12)
    pdf.set_draw_color(170)
    pdf.set_line_width(0.15)
    pdf.add_page()
    logo, _ = printed_logo(well.logo)
    if logo:
        pdf.image(io.BytesIO(logo), x=247, y=6, w=40, h=14, keep_aspect_ratio=True)
    pdf.set_font(_FONT, "", 8)
    with pdf.use_font_face(_bold(15)):
        pdf.multi_cell(0, 8, title, new_x="LMARGIN", new_y="NEXT")
    _head(pdf, report)
    _certificate(pdf, report, said.say)
    for section in report.sections:
        _section(pdf, section)
    return bytes(pdf.output())


def _head(pdf: Any, report: Content) -> None:
    pdf.set_font(_FONT, "", 8)
    half = (len(report.header) + 1) // 2
    with pdf.table(
        col_widths=(38, 100, 38, 100),
        borders_layout="NONE",
        line_height=4.2,
        first_row_as_headings=False,
        text_align="LEFT",
    ) as grid:
        for k in range(half):
            row = grid.row()
            for j in (k, k + half):
                label, value = report.header[j] if j < len(report.header) else ("", "")
                row.cell(label)
                row.cell(value)
    for note in report.notes:
        pdf.multi_cell(0, 4.6, f"• {note}", new_x="LMARGIN", new_y="NEXT")
    pdf.ln(2)


def _section(pdf: Any, section: Section) -> None:
    drawings = [_Placed(one, one.draw(), _room(pdf)) for one in section.drawings]
    # Keep a heading on the page of its table or drawing, and also the sentences that explain a drawing.
    follows = _SHEET + _BEGINNING
    if drawings and not section.sheets:
        follows = drawings[0].height * _SMALLER + _SENTENCE * len(section.text)
    if section.page or pdf.will_page_break(_HEADING + follows):
        pdf.add_page()
    _heading(pdf, section.heading, _HEADING, 11)
    for text in section.text:
        pdf.set_font(_FONT, "", 8)
        pdf.multi_cell(0, 4.6, text, new_x="LMARGIN", new_y="NEXT")
    for sheet in section.sheets:
        _sheet(pdf, sheet, sheet.heading if sheet.heading != section.heading else "")
    _drawings(pdf, drawings)


def _bold(size: float) -> FontFace:
    from fpdf.fonts import FontFace

    return FontFace(emphasis="BOLD", size_pt=size)


def _heading(pdf: Any, text: str, height: float, size: float) -> None:
    with pdf.use_font_face(_bold(size)):
        pdf.cell(0, height, text, new_x="LMARGIN", new_y="NEXT")


def _room(pdf: Any) -> float:
    """Return the height of a page below its title and the heading of a section, mm."""
    return float(pdf.h - pdf.t_margin - pdf.b_margin) - _TITLE - _HEADING - 1.0


class _Placed:
    """Drawing with its size on the page, mm: as wide as its column, unless it is then too high for a page."""

    def __init__(self, drawing: Drawing, figure: Figure, room: float) -> None:
        ratio = figure.get_figheight() / figure.get_figwidth()
        self.drawing, self.figure = drawing, figure
        self._ratio = ratio
        self.width = 225.0 if drawing.wide else _NARROW
        self.fit(room)

    @property
    def height(self) -> float:
        """Height of the drawing with its caption, mm."""
        return self.width * self._ratio + _CAPTION

    def fit(self, height: float) -> None:
        """Reduce the drawing so that it is at most `height` high with its caption, mm."""
        self.width = min(self.width, (height - _CAPTION) / self._ratio)


def _drawings(pdf: Any, placed: Sequence[_Placed]) -> None:
    """Print drawings in pairs side by side, wide ones alone."""
    column = 0
    for one in placed:
        wide = one.drawing.wide
        if column == 0 or wide:
            column = 0
            room = pdf.page_break_trigger - pdf.get_y()
            if room < _SMALLER * one.height:
                pdf.add_page()
            top = pdf.get_y()
        one.fit(pdf.page_break_trigger - top - 1.0)
        pdf.set_xy(10.0 + column * (_NARROW + 8.0), top)
        pdf.set_font(_FONT, "", 8)
        pdf.cell(one.width, _CAPTION - 1.0, one.drawing.caption, new_x="LEFT", new_y="NEXT")
        pdf.image(io.BytesIO(drawing.png(one.figure, 160)), w=one.width)
        one.figure.clear()
        pdf.set_xy(10.0, top + one.height + 2.0)
        column = 0 if wide or column else 1


def _sheet(pdf: Any, sheet: Sheet, heading: str) -> None:
    from fpdf.fonts import FontFace

    if heading:
        if pdf.will_page_break(_SHEET + _BEGINNING):
            pdf.add_page()
        _heading(pdf, heading, _SHEET, 9)
    pdf.set_font(_FONT, "", 6.5)
    # Column widths in proportion to the longest text, up to 40 characters.
    lengths = (
        [
            min(40, max(_width(t), _width(u), *(_width(r[k]) for r in sheet.rows), 3))
            for k, (t, u) in enumerate(zip(sheet.titles, sheet.units, strict=True))
        ]
        if sheet.rows
        else [max(3, _width(t)) for t in sheet.titles]
    )
    align = tuple("LEFT" if k in sheet.words else "RIGHT" for k in range(len(sheet.titles)))
    with pdf.table(
        col_widths=tuple(n + 3 for n in lengths),
        text_align=align,
        line_height=_row_height(pdf, len(sheet.rows) + bool(sheet.legend)),
        borders_layout="HORIZONTAL_LINES",
        headings_style=FontFace(emphasis="BOLD", fill_color=(238, 242, 245)),
    ) as grid:
        grid.row([f"{t}\n{u}" if u else t for t, u in zip(sheet.titles, sheet.units, strict=True)])
        shades = {word: FontFace(fill_color=colour) for word, colour in TINTS.items()}
        for i, (cells, mark) in enumerate(zip(sheet.rows, sheet.marks, strict=True)):
            row = grid.row(style=FontFace(fill_color=_MARK) if mark else None)
            for k, cell in enumerate(cells):
                row.cell(cell, style=shades.get(sheet.tints.get((i, k), "")))
    if sheet.legend:
        pdf.set_font(_FONT, "", 7)
        pdf.multi_cell(0, 4.2, sheet.legend, new_x="LMARGIN", new_y="NEXT")
    pdf.ln(3)


def _row_height(pdf: Any, rows: int) -> float:
    """Return the height of the rows of a table, mm: the first of `_ROWS` with which the last page has enough rows."""

    def last(height: float) -> int:
        """Return the number of rows on the last page of the table; the number of all rows if they fit on this page."""
        here, page = (int(room / height) - 2 for room in (pdf.page_break_trigger - pdf.get_y(), _room(pdf) + _HEADING))
        return rows if rows <= here else (rows - here) % page or page

    return next((height for height in _ROWS if last(height) > min(_ALONE, rows - 1)), _ROWS[0])


def _width(text: str) -> int:
    """Return the width of a text in letters; a Chinese character is as wide as two letters."""
    return sum(2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)


def _certificate(pdf: Any, report: Content, say: Callable[[str], str]) -> None:
    if pdf.will_page_break(_CERTIFICATE):
        pdf.add_page()
    _heading(pdf, say("Certificate"), _HEADING, 11)
    pdf.set_font(_FONT, "", 8)
    pdf.multi_cell(0, 5, report.certificate, new_x="LMARGIN", new_y="NEXT")
    pdf.ln(9)
    step = (pdf.epw + _GAP) / max(len(report.signatures), 3)
    for who in report.signatures:
        x, y = pdf.get_x(), pdf.get_y()
        pdf.set_draw_color(0)
        pdf.line(x, y, x + step - _GAP, y)
        pdf.set_xy(x, y + 1)
        pdf.cell(step - _GAP, 5, f"{who}{say(', ')}{say('date')}")
        pdf.set_xy(x + step, y)
    pdf.set_xy(pdf.l_margin, y + 9.0)
