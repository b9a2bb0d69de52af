# SPDX-License-Identifier: Apache-2.0
"""
Fonts of reports and plots: DejaVu from matplotlib, and a font with Chinese characters from this package.

The font with Chinese characters is a subset of Noto Sans SC (SIL Open Font License) that `make font` writes: the 3755
characters of level 1 of GB/T 2312, the characters of the catalogues, and common characters of names. The page uses the
same file. Rarer characters are taken from a complete font of the system, if one is installed.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from pathlib import Path

MAIN = "DejaVu Sans"
HOW = "install a font with them, such as the Debian package fonts-noto-cjk"
WIDE = Path(__file__).resolve().parents[1] / "page" / "static" / "vendor" / "NotoSansSC-subset.otf"
_FAMILIES = (
    *("Noto Sans SC", "Noto Sans CJK SC", "Noto Sans CJK JP", "Source Han Sans SC", "Source Han Sans CN"),
    *("Droid Sans Fallback", "WenQuanYi Micro Hei", "WenQuanYi Zen Hei", "Microsoft YaHei", "SimHei", "PingFang SC"),
)


def main_font(*, bold: bool = False) -> Path:
    """Return the file of the main font."""
    import matplotlib as mpl

    return Path(mpl.get_data_path()) / "fonts" / "ttf" / ("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf")


@functools.cache
def wide_fonts() -> tuple[Path, ...]:
    """Return the files of fonts with Chinese characters: from this package, then from the system if it has one."""
    from matplotlib.font_manager import fontManager

    known = {font.name: font.fname for font in fontManager.ttflist}
    return (WIDE, *[Path(known[name]) for name in _FAMILIES if name in known][:1])


@functools.cache
def families() -> tuple[str, ...]:
    """Return the font families for the texts of a figure, the main family first."""
    from matplotlib.font_manager import FontProperties, fontManager

    paths = wide_fonts()
    for path in paths:
        fontManager.addfont(path)
    return (MAIN, *(str(FontProperties(fname=str(path)).get_name()) for path in paths))


@functools.cache
def _characters(path: Path) -> frozenset[int]:
    from matplotlib.ft2font import FT2Font

    return frozenset(FT2Font(str(path)).get_charmap())


def needs_wide(texts: Iterable[str]) -> bool:
    """Return whether a text has characters that the main font does not have."""
    return bool(_without(texts, (main_font(),)))


def lacking(texts: Iterable[str]) -> str:
    """Return those characters of the texts that none of the fonts has."""
    return _without(texts, (main_font(), *wide_fonts()))


def _without(texts: Iterable[str], fonts: Iterable[Path]) -> str:
    known = frozenset[int]().union(*map(_characters, fonts))
    letters = {letter for text in texts for letter in text if letter.isprintable()}
    return "".join(sorted(letter for letter in letters if ord(letter) not in known))
