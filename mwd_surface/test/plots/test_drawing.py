# SPDX-License-Identifier: Apache-2.0
"""Colours of the plots."""

import itertools

from matplotlib.colors import to_rgb

from mwd_surface.plots.drawing import SERIES


def lightness(colour):
    """Lightness L* of CIELAB, 0 to 100."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    luminance = sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))
    return 116.0 * luminance ** (1 / 3) - 16.0 if luminance > 0.008856 else 903.3 * luminance


def test_lines_of_a_plot_differ_when_it_is_printed_in_grey():
    pairs = itertools.combinations(SERIES[:4], 2)
    assert min(abs(lightness(one) - lightness(other)) for one, other in pairs) > 15.0


def test_every_line_stands_out_from_white_paper():
    assert max(map(lightness, SERIES)) < 75.0
