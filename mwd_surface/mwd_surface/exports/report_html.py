"""The survey report as one HTML file: no script, nothing fetched, figures inside; prints on A4 with page numbers."""

from __future__ import annotations

import jinja2

from mwd_surface.exports.report_content import content
from mwd_surface.exports.report_plots import figures, svg
from mwd_surface.exports.survey_table import SurveyTable

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ c.title }}</title>
<style>
:root { color-scheme: light; }
body { font: 14px/1.45 "DejaVu Sans", Arial, sans-serif; color: #111; background: #fff; margin: 1.5rem auto;
  max-width: 78rem; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin: 0 0 .5rem; } h2 { font-size: 1.15rem; margin: 1.6rem 0 .4rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem; margin: 0; }
dt { color: #444; } dd { margin: 0; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; width: 100%; font-size: .82rem; }
th, td { padding: .18rem .4rem; border-bottom: 1px solid #ccc; text-align: right; white-space: nowrap; }
th { background: #eef2f5; vertical-align: bottom; } th small { font-weight: 400; display: block; }
.t { text-align: left; white-space: normal; }
tr.m td { background: #fff3e0; } tr.m td:first-child { border-left: 4px solid #d55e00; }
figure { display: inline-block; margin: .5rem 1rem .5rem 0; max-width: 100%; }
figure svg { max-width: 100%; height: auto; }
figcaption { color: #444; }
.sign { display: flex; gap: 3rem; margin-top: 3.5rem; flex-wrap: wrap; }
.sign div { border-top: 1px solid #111; min-width: 14rem; padding-top: .2rem; }
@page { size: A4 landscape; margin: 12mm;
  @bottom-right { content: "page " counter(page) " of " counter(pages); font-size: 9px; } }
@media print { body { margin: 0; max-width: none; } h2 { break-after: avoid; } tr, figure { break-inside: avoid; }
  thead { display: table-header-group; } .page { break-before: page; } }
</style>
</head>
<body>
<header><h1>{{ c.title }}</h1>
<dl>{% for label, value in c.header %}<dt>{{ label }}</dt><dd>{{ value }}</dd>
{% endfor %}</dl></header>
<main>
{% if c.notes %}<h2>Notes</h2><ul>{% for note in c.notes %}<li>{{ note }}</li>{% endfor %}</ul>{% endif %}
{% macro sheet(s) %}
<h2>{{ s.heading }}</h2>
<div class="scroll"><table><thead><tr>
{%- for title in s.titles %}<th scope="col"{% if loop.index0 in s.words %} class="t"{% endif %}>{{ title }}
{%- if s.units[loop.index0] %} <small>{{ s.units[loop.index0] }}</small>{% endif %}</th>{% endfor -%}
</tr></thead><tbody>
{% for row in s.rows %}<tr{% if s.marks[loop.index0] %} class="m" title="{{ s.marks[loop.index0] }}"{% endif %}>
{%- for cell in row %}<td{% if loop.index0 in s.words %} class="t"{% endif %}>{{ cell }}</td>{% endfor -%}
</tr>
{% endfor %}</tbody></table></div>
{% endmacro %}
{{ sheet(c.definitive) }}
<section class="page"><h2>Figures</h2>
{% for caption, figure in figures.items() %}<figure role="img" aria-label="{{ caption }}">{{ figure | safe }}
<figcaption>{{ caption }}</figcaption></figure>
{% endfor %}</section>
<section class="page">{{ sheet(c.quality) }}</section>
{% if c.decisions.rows %}{{ sheet(c.decisions) }}{% endif %}
{% for s in c.slides %}{{ sheet(s) }}{% endfor %}
<h2>Certificate</h2><p>{{ c.certificate }}</p>
<div class="sign">{% for who in c.signatures %}<div>{{ who }}, date</div>{% endfor %}</div>
</main>
</body>
</html>
"""


def report_html(table: SurveyTable) -> str:
    """The report of a table as HTML text (UTF-8 when encoded); texts from people are escaped."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=False)
    drawn = {}
    for caption, figure in figures(table).items():
        drawn[caption] = svg(figure)
        # A figure is a web of cycles; a node that draws one a survey must not wait for the collector.
        figure.clear()
    return environment.from_string(_PAGE).render(c=content(table), figures=drawn)
