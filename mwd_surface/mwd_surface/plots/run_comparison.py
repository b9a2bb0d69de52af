# SPDX-License-Identifier: Apache-2.0
"""Plot of two runs over one recording: inclination and azimuth of both, and their differences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.plots.drawing import SERIES, finish_axes, new_figure, time_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 6000  # smallest number of rows drawn of a long run; at most twice this number is drawn
_ANGLES = ("inclination_deg", "azimuth_deg")
_NAMES = ("inclination", "azimuth")


class ComparedRun(NamedTuple):
    """Results of `mwd process`: name, blocks of attitude (stamp_ns, ns, and angles, deg), and surveys."""

    name: str
    attitude: Iterable[Mapping[str, Any]]
    surveys: list[dict[str, str]]


def thinned(attitude: Iterable[Mapping[str, Any]]) -> dict[str, Array]:
    """
    Return rows of the attitude of a run at equal intervals: stamp_ns, ns, and the angles, deg, shape (n,) each.

    At most 2 * `_MOST` rows are kept, so memory is constant.
    """
    kept: dict[str, list[Array]] = {name: [] for name in ("stamp_ns", *_ANGLES)}
    step, place = 1, 0
    for block in attitude:
        first = -place % step
        place += len(block["stamp_ns"])
        for name, parts in kept.items():
            parts.append(np.asarray(block[name][first::step]))
        if sum(map(len, kept["stamp_ns"])) > 2 * _MOST:
            step *= 2
            # Keep the first row, so that later rows continue with the same spacing.
            kept = {name: [np.concatenate(parts)[::2]] for name, parts in kept.items()}
    return {name: np.concatenate(parts) if parts else np.empty(0) for name, parts in kept.items()}


def picture(ours: ComparedRun, expected: ComparedRun) -> Figure:
    """Return a figure of inclination and azimuth of two runs with their surveys, and of the differences."""
    runs = [(run.name, thinned(run.attitude), run.surveys) for run in (ours, expected)]
    begin = min((int(rows["stamp_ns"][0]) for _, rows, _ in runs if len(rows["stamp_ns"])), default=0)
    last = max((int(rows["stamp_ns"][-1]) for _, rows, _ in runs if len(rows["stamp_ns"])), default=0)
    unit_s, unit = time_unit((last - begin) * 1e-9)
    figure = new_figure(11.0, 9.0)
    upper, middle, lower = figure.subplots(3, 1, sharex=True)
    for colour, (name, rows, surveys) in zip(SERIES, runs, strict=False):
        time = (rows["stamp_ns"] - begin) * 1e-9 / unit_s
        for ax, angle in ((upper, "inclination_deg"), (middle, "azimuth_deg")):
            ax.plot(time, rows[angle], color=colour, linewidth=0.9, label=name)
            at, value = _stations(surveys, angle, begin, unit_s)
            ax.plot(at, value, "o", color=colour, markersize=5, fillstyle="none")
    apart = differences(runs[0][1], runs[1][1])
    time = (apart["stamp_ns"] - begin) * 1e-9 / unit_s
    for colour, angle, words in zip(SERIES, _ANGLES, _NAMES, strict=False):
        lower.plot(time, apart[angle], color=colour, linewidth=0.9, label=words)
    lower.axhline(0.0, color="k", linewidth=0.7)
    for ax, label in (
        (upper, "inclination, deg"),
        (middle, "azimuth, deg"),
        (lower, f"{runs[0][0]} minus {runs[1][0]}, deg"),
    ):
        ax.set_ylabel(label, fontsize=9)
        finish_axes(ax, legend=True)
    lower.set_xlabel(unit, fontsize=9)
    return figure


def _stations(surveys: list[dict[str, str]], angle: str, begin: int, unit_s: float) -> tuple[list[float], list[float]]:
    """Return times, in units of `unit_s`, and angles, deg, of those surveys of a run that have the angle."""
    known = [row for row in surveys if row.get(angle)]
    return [(int(row["stamp_ns"]) - begin) * 1e-9 / unit_s for row in known], [float(row[angle]) for row in known]


def differences(ours: dict[str, Array], expected: dict[str, Array]) -> dict[str, Array]:
    """
    Return the differences of two runs from `thinned`, at the stamps of `ours`, with `expected` interpolated.

    The result has stamp_ns, ns, and the difference of each angle, deg, from -180 to 180, shape (n,); NaN if `expected`
    has no rows.
    """
    stamps = ours["stamp_ns"]
    found: dict[str, Array] = {"stamp_ns": stamps}
    for angle in _ANGLES:
        if not len(stamps) or not len(expected["stamp_ns"]):
            found[angle] = np.full(len(stamps), np.nan)
            continue
        rad = np.radians(expected[angle])
        x, y = (np.interp(stamps, expected["stamp_ns"], part) for part in (np.cos(rad), np.sin(rad)))
        apart = ours[angle] - np.degrees(np.arctan2(y, x))
        found[angle] = (apart + 180.0) % 360.0 - 180.0
    return found
