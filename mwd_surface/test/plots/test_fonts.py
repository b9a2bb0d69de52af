# SPDX-License-Identifier: Apache-2.0
"""The fonts of Chinese texts: every character has a glyph, in plots and in PDF files."""

import io
import warnings

import pypdf
import pytest
from fontTools.ttLib import TTFont
from fpdf import FPDF
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from mwd_surface.language.language import language
from mwd_surface.plots import drawing as fonts
from mwd_surface.plots.drawing import png, svg

CHINESE = language("zh_CN")
LEVEL_1 = b"".join(bytes([row, cell]) for row in range(0xB0, 0xD8) for cell in range(0xA1, 0xFF))
LEVEL_1 = LEVEL_1.decode("gb2312", errors="ignore")
HANZI = sorted({*"".join(CHINESE.entries.values())} & {*LEVEL_1})


@pytest.fixture(autouse=True)
def no_font_of_the_system(monkeypatch):
    """Leave out the fonts of this machine, so that each machine tests the same."""
    monkeypatch.setattr(fonts, "wide_fonts", lambda: (fonts.WIDE,))
    fonts.families.cache_clear()
    yield
    fonts.families.cache_clear()


def test_the_font_has_every_character_of_the_catalogue_and_of_everyday_texts():
    assert len(LEVEL_1) == 3755
    assert not fonts.lacking([*CHINESE.entries, *CHINESE.entries.values(), LEVEL_1, "℃①Ⅲ—，。、；：「」"])


def test_the_font_is_small_free_and_says_its_name():
    assert fonts.WIDE.stat().st_size < 1 << 20
    with TTFont(fonts.WIDE) as font:
        assert font["name"].getDebugName(1) == "Noto Sans SC Subset"
        assert "SIL Open Font License" in font["name"].getDebugName(13)
    assert "SIL OPEN FONT LICENSE Version 1.1" in fonts.WIDE.with_name("NotoSansSC-OFL.txt").read_text(encoding="ascii")


def test_characters_that_no_font_has_are_named():
    assert fonts.lacking(["孔深 \U00020000", "m"]) == "\U00020000"


@pytest.mark.slow
@pytest.mark.parametrize("draw", [png, svg])
def test_a_plot_with_chinese_texts_has_all_glyphs(draw):
    figure = Figure()
    axes = figure.subplots()
    axes.plot([1, 2], [3, 4], label="左右偏差 ±2σ")
    axes.set_title("寺河矿 3 号钻场 · Δ 倾角")
    axes.set_xlabel("孔深，m")
    axes.legend()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert draw(figure)


@settings(deadline=None, max_examples=settings().max_examples // 3)
@given(st.text(alphabet=st.sampled_from(HANZI), min_size=1))
def test_a_pdf_reader_finds_the_text_that_was_written(text):
    pdf = FPDF()
    pdf.add_font("wide", "", fonts.WIDE)
    pdf.set_font("wide", "", 8)
    pdf.add_page()
    pdf.multi_cell(0, 5, text)
    read = pypdf.PdfReader(io.BytesIO(bytes(pdf.output())))
    assert read.pages[0].extract_text().replace("\0", "").replace("\n", "") == text
    names = {str(font.get_object()["/BaseFont"]) for font in read.pages[0]["/Resources"]["/Font"].values()}
    assert all("NotoSansSC" in name for name in names), names
