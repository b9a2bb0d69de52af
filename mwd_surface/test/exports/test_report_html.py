# SPDX-License-Identifier: Apache-2.0
"""The HTML report stands alone, escapes what people wrote, and is well formed."""

import html
import re

import example_surveys as example
import pytest
from lxml import etree

from mwd_surface.exports.report_content import content
from mwd_surface.exports.report_html import report_html

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def page():
    return report_html(example.table())


def test_nothing_is_fetched_and_nothing_runs(page):
    assert "<script" not in page
    assert "default-src 'none'" in page
    links = re.findall(r"""(?:src|href)=["']([^"']*)["']""", page)
    assert [link for link in links if not link.startswith(("#", "data:"))] == []
    assert "@import" not in page
    assert "url(http" not in page


@pytest.mark.parametrize("stretches", [(), example.stretches()])
def test_every_cell_of_every_table_is_on_the_page(stretches, page):
    given = example.table(stretches=stretches)
    tree = etree.HTML(report_html(given) if stretches else page)
    reported = content(given)
    tables = tree.findall(".//table")
    for table, sheet in zip(tables, reported.sheets, strict=True):
        rows = [tuple("".join(td.itertext()) for td in tr.findall("td")) for tr in table.findall("tbody/tr")]
        assert tuple(rows) == sheet.rows
    heads = dict(zip((dt.text for dt in tree.findall(".//dt")), (dd.text for dd in tree.findall(".//dd")), strict=True))
    assert heads == dict(reported.header)


@pytest.mark.fault_case(82)
def test_what_people_wrote_is_escaped():
    bad = "<img src=x onerror=alert(1)>"
    page = report_html(example.table(well={"name": bad, "rig": bad}))
    assert bad not in page
    assert html.escape(bad) in page


def test_the_same_table_gives_the_same_page(page):
    assert report_html(example.table()) == page
