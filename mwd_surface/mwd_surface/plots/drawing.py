# SPDX-License-Identifier: Apache-2.0
"""
Common parts of all plots: units, colours, style of axes, fonts, and the bytes of a file.

The fonts of reports and plots are DejaVu from matplotlib, and a font with Chinese characters from this package: a
subset of Noto Sans SC (SIL Open Font License) that `make font` writes, with the 3755 characters of level 1 of
GB/T 2312, the characters of the catalogues, and common characters of names. The page uses the same file. Rarer
characters are taken from a complete font of the system, if one is installed.
"""

from __future__ import annotations

import functools
import io
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mwd_sensors.core import minimum_curvature
from mwd_sensors.core.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of lines, after Okabe and Ito, which colour-blind readers can distinguish. The first four also differ in
# lightness (27, 53, 70 and 0 %), so that a plot printed in grey can be read.
BLUE, RED, SKY, BLACK, PURPLE = "#0B3C7D", "#D55E00", "#56B4E9", "#000000", "#CC79A7"
SERIES = (BLUE, RED, SKY, BLACK, PURPLE)
# Colours with a meaning; each is used together with a mark or a word.
GOOD, DOUBTFUL, BAD, NEUTRAL = "#009E73", "#E69F00", RED, "#999999"
TRUTH_COLOUR, GRID_COLOUR = "#555555", "#cccccc"
DEGREES = 180.0 / math.pi


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size, inches, that arranges its axes and legends itself."""
    # Do not use pyplot, which keeps every figure in a global list.
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def arcs(md: Array, inclination: Array, azimuth: Array, positions: Array) -> tuple[Array, Array]:
    """Return dense measured depths, m, shape (n,), and positions, m, shape (n, 3), to draw a path as arcs."""
    if md.size < 2:
        return md, positions
    dense = np.unique(np.concatenate([md, np.linspace(md[0], md[-1], 400)]))
    return dense, minimum_curvature.interpolate(md, inclination, azimuth, positions, dense)[2]


def drawer(draw: Callable[..., None], *given: Any) -> Callable[[Axes], None]:
    """Return a function of the axes that calls `draw` with the axes and the arguments `given`."""
    return lambda ax: draw(ax, *given)


def finish_axes(ax: Axes, *, legend: bool = False) -> None:
    """Give axes the common style, and a legend if wanted."""
    grid(ax)
    ax.tick_params(labelsize=8)
    ax.spines[["top", "right"]].set_visible(False)
    if legend:
        ax.legend(fontsize=8, frameon=False)


def grid(ax: Axes) -> None:
    """Draw the common grid."""
    ax.grid(visible=True, linewidth=0.4, color=GRID_COLOUR)


def with_fonts(figure: Figure) -> Figure:
    """Set the font with Chinese characters for texts that the main font cannot show; return the figure."""
    from matplotlib.patheffects import withStroke
    from matplotlib.text import Text

    for item in figure.findobj(Text):
        if needs_wide((item.get_text(),)):
            item.set_fontfamily(list(families()))
            if item.get_fontweight() == "bold":
                # The font has only a regular weight: draw thicker outlines for bold, as in the PDF report.
                width = 0.04 * float(item.get_fontsize())
                item.set_fontweight("normal")
                item.set_path_effects([withStroke(linewidth=width, foreground=item.get_color())])
    return figure


def translate(figure: Figure, say: Callable[[str], str]) -> Figure:
    """Translate the texts of a figure; return the figure. A text is not translated if no font has the characters."""
    from matplotlib.text import Text

    for item in figure.findobj(Text):
        said = say(item.get_text())
        if not lacking((said,)):
            item.set_text(said)
    return figure


def png(figure: Figure, dots_per_inch: int = 130) -> bytes:
    """Return the figure as PNG bytes; the same figure gives the same bytes."""
    out = io.BytesIO()
    with_fonts(figure).savefig(out, format="png", dpi=dots_per_inch, metadata={"Software": None})
    return out.getvalue()


def svg(figure: Figure) -> str:
    """Return the figure as an SVG document; the same figure gives the same text."""
    import matplotlib as mpl

    out = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "mwd", "svg.fonttype": "path"}):
        with_fonts(figure).savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()


def time_unit(seconds: float) -> tuple[float, str]:
    """Return the unit of the time axis for a span of `seconds`: length of the unit in seconds, and its name."""
    if seconds <= 300.0:
        return 1.0, "seconds"
    return (60.0, "minutes") if seconds <= 3.0 * 3600.0 else (3600.0, "hours")


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
