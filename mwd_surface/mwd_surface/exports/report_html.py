# SPDX-License-Identifier: Apache-2.0
"""The survey report as one HTML file: no scripts, no external files, figures inside; prints as A4 with page numbers."""

from __future__ import annotations

import base64

import jinja2

from mwd_sensors.core.foreign_text import printable
from mwd_surface.exports.report_content import content, printed_logo
from mwd_surface.exports.report_edge import for_people
from mwd_surface.exports.report_section import TINTS, Drawing
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.language.language import language
from mwd_surface.plots.drawing import svg

_PAGE = """<!DOCTYPE html>
<html lang="{{ code }}">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ c.title }}</title>
<style>
:root { color-scheme: light; }
body { font: 14px/1.45 "DejaVu Sans", "Noto Sans SC", "Noto Sans CJK SC",
  "Microsoft YaHei", "PingFang SC", Arial, sans-serif; color: #111; background: #fff; margin: 1.5rem auto;
  max-width: 78rem; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin: 0 0 .5rem; } h2 { font-size: 1.15rem; margin: 1.6rem 0 .4rem; }
img.logo { float: right; max-height: 3.5rem; max-width: 12rem; }
h3 { font-size: 1rem; margin: 1.2rem 0 .3rem; }
dl { display: grid; grid-template-columns: max-content 1fr max-content 1fr; gap: .1rem 1rem; margin: 0; }
dt { color: #444; } dd { margin: 0; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; width: 100%; font-size: .82rem; }
th, td { padding: .18rem .4rem; border-bottom: 1px solid #ccc; text-align: right; white-space: nowrap; }
th { background: #eef2f5; vertical-align: bottom; } th small { font-weight: 400; display: block; }
.t { text-align: left; } .long { white-space: normal; min-width: 12rem; }
tr.m td { background: #fff3e0; } tr.m td:first-child { border-left: 4px solid #d55e00; }
{% for word, colour in tints.items() %}td.{{ word }}, tr.m td.{{ word }} { background: {{ colour }}; }
{% endfor %}p.legend { color: #444; font-size: .82em; margin: .3rem 0 0; }
figure { display: inline-block; margin: .5rem 1% .5rem 0; width: 48%; min-width: 20rem; vertical-align: top; }
figure.wide { width: 100%; }
figure svg { max-width: 100%; height: auto; }
figcaption { color: #444; }
.sign { display: flex; gap: 3rem; margin-top: 3.5rem; flex-wrap: wrap; }
.sign div { border-top: 1px solid #111; min-width: 14rem; padding-top: .2rem; }
@page { size: A4 landscape; margin: 12mm;
  @bottom-right { font-size: 9px;
    content: "{{ page[0] }}" counter(page) "{{ page[1] }}" counter(pages) "{{ page[2] }}"; } }
@media screen and (max-width: 60rem) { dl { grid-template-columns: max-content 1fr; } figure { width: 100%; } }
@media print { body { margin: 0; max-width: none; font-size: 8.5pt; padding: 0; } table { font-size: 6.6pt; }
  th, td { padding: .1rem .25rem; } .long { min-width: 0; } .scroll { overflow: visible; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  h2 { break-after: avoid; } tr, figure { break-inside: avoid; }
  thead { display: table-header-group; } .page { break-before: page; } }
</style>
</head>
<body>
<header>{% if logo %}<img class="logo" alt="" src="{{ logo }}">{% endif %}<h1>{{ c.title }}</h1>
<dl>{% for label, value in c.header %}<dt>{{ label }}</dt><dd>{{ value }}</dd>
{% endfor %}</dl></header>
<main>
{% if c.notes %}<h2>{{ say("Notes") }}</h2><ul>{% for note in c.notes %}<li>{{ note }}</li>{% endfor %}</ul>{% endif %}
<h2>{{ say("Certificate") }}</h2><p>{{ c.certificate }}</p>
<div class="sign">{% for who in c.signatures %}<div>{{ who }}, {{ say("date") }}</div>{% endfor %}</div>
{% for part in c.sections %}<section{% if part.page %} class="page"{% endif %}>
<h2>{{ part.heading }}</h2>
{% for text in part.text %}<p>{{ text }}</p>{% endfor %}
{% for s in part.sheets %}
{%- if s.heading != part.heading %}<h3>{{ s.heading }}</h3>{% endif %}
<div class="scroll"><table><thead><tr>
{%- for title in s.titles %}<th scope="col"{% if loop.index0 in s.words %} class="t"{% endif %}>{{ title }}
{%- if s.units[loop.index0] %} <small>{{ s.units[loop.index0] }}</small>{% endif %}</th>{% endfor -%}
</tr></thead><tbody>
{% for row in s.rows %}{% set i = loop.index0 %}<tr{% if s.marks[i] %} class="m" title="{{ s.marks[i] }}"{% endif %}>
{%- for cell in row %}{% set tint = s.tints.get((i, loop.index0), "") -%}
{% set left = ("t long " if cell|length > 28 else "t ") if loop.index0 in s.words else "" -%}
<td{% if left or tint %} class="{{ left }}{{ tint }}"{% endif %}>
{{- cell }}</td>{% endfor -%}
</tr>
{% endfor %}</tbody></table></div>
{% if s.legend %}<p class="legend">{{ s.legend }}</p>{% endif %}
{% endfor %}
{% for drawing in part.drawings %}<figure role="img" aria-label="{{ drawing.caption }}"
{%- if drawing.wide %} class="wide"{% endif %}>{{ drawn(drawing) | safe }}
<figcaption>{{ drawing.caption }}</figcaption></figure>
{% endfor %}</section>
{% endfor %}
</main>
</body>
</html>
"""


def report_html(table: SurveyTable) -> str:
    """
    Return the report of a table as HTML text (UTF-8 when encoded); user texts are escaped.

    Raises ValueError if the language of the well is unknown.
    """
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=False,
        finalize=lambda value: printable(value) if type(value) is str else value,
    )
    well = table.surveys.well
    said = language(well.language)
    logo, kind = printed_logo(well.logo)
    words = said.say("page {page_no} of {nb}").replace("{page_no}", "|").replace("{nb}", "|").split("|")
    return environment.from_string(_PAGE).render(
        c=for_people(content(table), said, well.units),
        drawn=_drawn,
        tints=TINTS,
        say=said.say,
        code=said.code.replace("_", "-"),
        page=words,
        logo=f"data:{kind};base64,{base64.b64encode(logo).decode()}" if logo else "",
    )


def _drawn(drawing: Drawing) -> str:
    figure = drawing.draw()
    text = svg(figure)
    # Omit the head of the SVG document, so that the figure is an element of the page.
    text = text[text.index("<svg") :]
    # A figure has many reference cycles; free its memory here, because a node draws a figure per survey.
    figure.clear()
    return text
