# SPDX-License-Identifier: Apache-2.0
"""
Fonts of reports and plots: DejaVu, which comes with matplotlib, and a second one with Chinese characters, if any.

A font with Chinese characters has several megabytes, so none comes with this package. `pip install
pylopdf-fonts-zh-cn` (Noto Sans SC, 17 MB, SIL Open Font License) installs one. Chinese fonts of the system work too.
"""

from __future__ import annotations

import functools
import importlib.resources
import importlib.util
from collections.abc import Iterable
from pathlib import Path

MAIN = "DejaVu Sans"
HOW = (
    "pip install pylopdf-fonts-zh-cn, or a font of the system such as the Debian package fonts-noto-cjk or "
    "fonts-droid-fallback"
)
_PACKAGE = "pylopdf_fonts_zh_cn"
_FAMILIES = (
    *("Noto Sans SC", "Noto Sans CJK SC", "Source Han Sans SC", "Source Han Sans CN", "Droid Sans Fallback"),
    *("WenQuanYi Micro Hei", "WenQuanYi Zen Hei", "Microsoft YaHei", "SimHei", "PingFang SC"),
)


def main_font(*, bold: bool = False) -> Path:
    """Return the file of the main font."""
    import matplotlib as mpl

    return Path(mpl.get_data_path()) / "fonts" / "ttf" / ("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf")


@functools.cache
def wide_font() -> Path | None:
    """Return the file of a font with Chinese characters, from the package or the system; None if there is none."""
    if importlib.util.find_spec(_PACKAGE) is not None:
        path = Path(str(importlib.resources.files(_PACKAGE))) / "NotoSansSC-Regular.otf"
        if path.exists():
            return path
    from matplotlib.font_manager import fontManager

    known = {font.name: font.fname for font in fontManager.ttflist}
    return next((Path(known[name]) for name in _FAMILIES if name in known), None)


@functools.cache
def families() -> tuple[str, ...]:
    """Return the families for the texts of a figure, the main one first."""
    from matplotlib.font_manager import FontProperties, fontManager

    path = wide_font()
    if path is None:
        return (MAIN,)
    fontManager.addfont(path)
    return (MAIN, str(FontProperties(fname=str(path)).get_name()))


@functools.cache
def _characters() -> frozenset[int]:
    from matplotlib.ft2font import FT2Font

    return frozenset(FT2Font(str(main_font())).get_charmap())


def needs_wide(texts: Iterable[str]) -> bool:
    """Return whether a text has characters that the main font does not have."""
    return any(ord(letter) not in _characters() for text in texts for letter in text if letter.isprintable())


def lacking(text: str) -> bool:
    """Return whether a text has characters that the main font does not have, and there is no wide font."""
    return wide_font() is None and needs_wide((text,))
