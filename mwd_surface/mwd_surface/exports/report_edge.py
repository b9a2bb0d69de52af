# SPDX-License-Identifier: Apache-2.0
"""
Conversion of the report's content to the language and the units of the well.

The content is made in English and metric units, for tests and other programs. This file converts the numbers, from
their values before rounding, and translates the texts.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mwd_surface.exports.report_section import Drawing, Section, Sheet
from mwd_surface.language.language import Language
from mwd_surface.plots.drawing import translate
from mwd_surface.signals.cells import Printed, Typed, fixed
from mwd_surface.signals.units import FIELD, FOOT, UNITS, UnitScale

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mwd_surface.exports.report_content import Content

# Conversions from SI to the field unit, and to the metric unit, by the symbol of the metric unit in the report.
_FIELD: dict[str, UnitScale] = {unit.people.symbol: unit.fps for unit in UNITS.values() if unit.endings[1]}
_SI: dict[str, UnitScale] = {unit.people.symbol: unit.people for unit in UNITS.values() if unit.endings[1]}
# Symbols that the report writes with a space, by their form in data files.
_SYMBOLS = {"deg/100ft": "deg/100 ft"}
# Pattern of a length or a dogleg severity in a sentence; coordinates of a map grid (m E, m N) are not matched.
_IN_TEXT = re.compile(r"(?<![\w.])(-?\d+(?:[.,](\d+))?) ?(m|(?:deg|°)/30 m)(?![\w/^]| [EN东北])", re.ASCII)


class Edge(NamedTuple):
    """Conversion of texts and numbers to the language and units of a report."""

    language: Language
    field: bool
    names: frozenset[str] = frozenset()  #: texts of the report that people have typed

    def text(self, text: str) -> str:
        """Return a sentence of the report converted and translated; return a text that people typed unchanged."""
        if isinstance(text, Typed):
            return text
        said = self.language.say(text)
        return _IN_TEXT.sub(self._converted, said) if self.field else said

    def head(self, label: str, value: str) -> str:
        """Return a value of the head block converted and translated; coordinates of a map grid remain in metres."""
        return self.language.say(value) if label == "Map grid" else self.text(value)

    def _converted(self, match: re.Match[str]) -> str:
        unit = match[3].replace("°", "deg")
        number = _FIELD[unit].of(_SI[unit].si(float(match[1].replace(",", "."))))
        return f"{self.language.number(fixed(number, len(match[2] or '')))} {self.unit(unit)}"

    def unit(self, unit: str) -> str:
        """Return the symbol of a unit, from a column or the end of an axis label, converted and translated."""
        head, space, tail = unit.partition(" slid")
        scale = _FIELD.get(head) if self.field else None
        symbol = head if scale is None else _SYMBOLS.get(scale.symbol, scale.symbol)
        return self.language.entries.get(symbol + space + tail) or self.language.say(symbol + space + tail)

    def cell(self, cell: str, unit: str) -> str:
        """Return a cell, converted and translated; unit: unit of the column."""
        unit = unit.removesuffix(" slid")
        if not isinstance(cell, Printed):
            return self.text(cell)
        if self.field and unit in _FIELD:
            cell = fixed(_FIELD[unit].of(_SI[unit].si(cell.number)), cell.decimals)
        return self.language.number(str(cell))

    def drawn(self, text: str) -> str:
        """Return a text of a drawing translated; a name that people typed is returned unchanged."""
        if text in self.names:
            return text
        return "\n".join(map(self.unit if "\n" in text else self.language.say, text.split("\n")))


def for_people(content: Content, language: Language, units: str) -> Content:
    """Return the content of a report in a language, and in metric or field units."""
    edge = Edge(language, units == FIELD, frozenset(str(one) for one in content.words() if isinstance(one, Typed)))
    return dataclasses.replace(
        content,
        title=language.say(content.title),
        header=tuple((language.say(label), edge.head(label, value)) for label, value in content.header),
        notes=tuple(map(edge.text, content.notes)),
        sections=tuple(_section(edge, section) for section in content.sections),
        certificate=edge.text(content.certificate),
        signatures=tuple(map(edge.text, content.signatures)),
    )


def _section(edge: Edge, section: Section) -> Section:
    return dataclasses.replace(
        section,
        heading=edge.text(section.heading),
        text=tuple(map(edge.text, section.text)),
        sheets=tuple(_sheet(edge, sheet) for sheet in section.sheets),
        drawings=tuple(_drawing(edge, drawing) for drawing in section.drawings),
    )


def _sheet(edge: Edge, sheet: Sheet) -> Sheet:
    return dataclasses.replace(
        sheet,
        heading=edge.text(sheet.heading),
        titles=tuple(map(edge.language.say, sheet.titles)),
        units=tuple(map(edge.unit, sheet.units)),
        rows=tuple(
            tuple(edge.cell(cell, unit) for cell, unit in zip(row, sheet.units, strict=True)) for row in sheet.rows
        ),
        marks=tuple(map(edge.language.say, sheet.marks)),
        legend=edge.text(sheet.legend),
    )


def _drawing(edge: Edge, drawing: Drawing) -> Drawing:
    return dataclasses.replace(drawing, caption=edge.text(drawing.caption), draw=_drawer(edge, drawing.draw))


def _drawer(edge: Edge, draw: Callable[[], Figure]) -> Callable[[], Figure]:
    def drawn() -> Figure:
        figure = draw()
        if edge.language.entries:
            translate(figure, edge.drawn)
        for axes in figure.axes if edge.field else ():
            _in_feet(axes)
        return figure

    return drawn


def _in_feet(axes: Any) -> None:
    """Change each axis of a plot that is labelled in metres to labels in feet, with ticks at round numbers of feet."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    class Feet(MaxNLocator):
        """Locator of ticks at round numbers of feet on an axis in metres."""

        def tick_values(self, vmin: float, vmax: float) -> Any:
            return np.asarray(super().tick_values(vmin / FOOT, vmax / FOOT)) * FOOT

    for axis in (axes.xaxis, axes.yaxis):
        label = axis.get_label_text()
        if label.endswith((", m", "，m")):
            axis.set_label_text(f"{label[:-1]}ft")
            axis.set_major_locator(Feet(nbins=8, steps=[1, 2, 2.5, 5, 10]))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{round(value / FOOT, 6):g}"))
