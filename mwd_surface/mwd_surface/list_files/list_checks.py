# SPDX-License-Identifier: Apache-2.0
"""
Checks of a list against itself: impossible depths and doglegs, and angles that contradict the list's own positions.

A contradictory list is refused and its likely cause is named: each usual mistake is undone in turn, until angles and
positions agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.list_files.station_list import POSITION

# Largest measured depth of a survey, m; a list with a greater depth must be confirmed. The longest hole so far is
# 15.2 km long.
DEEPEST = 20_000.0
_ARC = 60.0  # largest distance between two stations of a complete list, m
_IMPOSSIBLE = 100_000.0  # largest depth that the caller can confirm, m
_FARTHEST = 4.1e7  # largest coordinate of a map, m: the circumference of the Earth
# Largest dogleg of a usual hole, rad/m. After short radius drilling, the caller confirms a larger dogleg.
_DOGLEG = math.radians(30.0) / 30.0
# A misfit of north and east above _NOTICED, m, is due to mixed units if a change of the unit reduces the misfit to less
# than the share _CLEARLY.
_NOTICED, _CLEARLY = 0.3, 0.1
# Inclination and azimuth look exchanged if the "azimuth" begins as the inclination of a vertical hole does, below
# _UPRIGHT, rad, while the "inclination" is above _INCLINED, rad, and changes less than the "azimuth".
_UPRIGHT, _INCLINED = math.radians(5.0), math.radians(10.0)
# Inclination above which a hole rises, with a margin for a lateral that is toe-up, rad.
_RISING = math.radians(100.0)
# Largest change of direction between neighbouring stations that rounding or a change of tool may cause, rad.
_ROUNDING = math.radians(1.0)


def check_depths(md: Array, at: Sequence[str], given: Given) -> tuple[Remark, ...]:
    """
    Refuse depths, m, that are impossible; return a remark if the caller confirmed a depth above `DEEPEST`.

    at: place of each station in the file, for messages.

    Raises
    ------
    ListFileError
        A depth is negative, above 100 km, or above `DEEPEST` without confirmation of "depth" by the caller.
    """
    for k in map(int, np.flatnonzero(md < 0.0)):
        raise ListFileError(f"{at[k]}: measured depth {md[k]:g} m is above the wellhead; depths count downwards")
    for k in map(int, np.flatnonzero(md > _IMPOSSIBLE)):
        raise ListFileError(
            f"{at[k]}: measured depth {md[k]:g} m is deeper than any hole can be; check the unit and the decimal mark"
        )
    deep = np.flatnonzero(md > DEEPEST)
    if not deep.size:
        return ()
    text = f"{at[deep[0]]}: measured depth {md[deep[0]]:g} m is deeper than any hole"
    if "depth" in given.confirm:
        return (Remark(RemarkKind.CONFIRMED, f"{text}; confirmed", {"depth": float(md[deep[0]])}),)
    raise ListFileError(f"{text}; check the unit and the decimal mark, or confirm it with --confirm depth")


def are_sharp(turned: Array, length: Array) -> np.ndarray:
    """
    Return which doglegs are above 30 deg/30 m plus 1 deg, almost always errors in the list, bool, shape (n,).

    turned, length: change of direction, rad, and distance, m, between n pairs of neighbouring stations.
    """
    return np.asarray(turned > _DOGLEG * length + _ROUNDING)


def check_doglegs(columns: tuple[Array, Array, Array], at: Sequence[str], given: Given) -> tuple[Remark, ...]:
    """
    Refuse doglegs that are sharp (`are_sharp`); return a remark if the caller has confirmed them.

    columns: measured depth, m, inclination and azimuth, rad. at: place of each station in the file, for messages.

    Raises
    ------
    ListFileError
        Two neighbouring stations differ too much in direction, and the caller has not confirmed the dogleg.
    """
    md, inc, azi = columns
    turned = mc.dogleg(inc[:-1], azi[:-1], inc[1:], azi[1:])
    length = np.diff(md)
    sharp = np.flatnonzero(are_sharp(turned, length))
    if not sharp.size:
        return ()
    k = int(sharp[0])
    severity = math.degrees(turned[k]) / length[k] * 30.0
    text = (
        f"{at[k + 1]}: the hole turns by {math.degrees(turned[k]):.1f} deg over {length[k]:.2f} m,"
        f" {severity:.0f} deg/30 m, which is implausible"
    )
    if sharp.size > 1:
        text += f"; {sharp.size} intervals of the list have such a dogleg"
    if "dogleg" in given.confirm:
        return (Remark(RemarkKind.CONFIRMED, f"{text}; confirmed", {"dogleg": float(severity)}),)
    hint = ""
    if np.all(azi <= math.pi) and not np.any(are_sharp(mc.dogleg(azi[:-1], inc[:-1], azi[1:], inc[1:]), length)):
        hint = "; the columns of inclination and azimuth may be exchanged"
    raise ListFileError(f"{text}: check depths, units and angles{hint}, or confirm it with --confirm dogleg")


def check_exchange(name: str, columns: tuple[Array, Array, Array], positions: Array) -> tuple[Remark, ...]:
    """
    Return a remark if inclination and azimuth of a list look exchanged; none if listed positions confirm the angles.

    The path of exchanged columns is smooth, so that no other check finds the mistake. The columns look exchanged if
    only the other way round the hole begins nearly vertical, or if only the other way round it does not rise.
    name: name of the list; columns: measured depth, m, inclination and azimuth, rad, without missing values.
    """
    _, inc, azi = columns
    if inc.size < 2 or np.any(azi > math.pi) or np.any(np.isfinite(positions[1:])):
        return ()
    # A station straight down with azimuth 0 is the same either way round.
    either = np.maximum(inc, azi) < _ROUNDING
    inc, azi = inc[~either], azi[~either]
    if not inc.size:
        return ()
    begins = azi[0] <= _UPRIGHT and inc[0] > _INCLINED and np.ptp(azi) > max(_INCLINED, np.ptp(inc))
    rises = np.min(inc) > _RISING and np.max(azi) <= _RISING
    if not (begins or rises):
        return ()
    why = "begins nearly vertical" if begins else "does not rise above its first station"
    text = (
        f"{name}: the columns of inclination and azimuth may be exchanged, because only with exchanged columns the hole"
        f" {why}; check them, and choose them with --columns inclination=NAME,azimuth=NAME"
    )
    return (Remark(RemarkKind.COLUMNS_EXCHANGED, text),)


def allowed(md: Array) -> Array:
    """
    Return the largest allowed distance between listed and computed positions, m.

    The distance grows with depth, because calculation methods differ, and with gaps where stations are missing.
    """
    # Between distant stations the hole does not follow one arc.
    gaps = np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(md) - _ARC, 0.0))])
    return np.asarray(1.0 + 0.005 * (md - md[0]) + 0.1 * gaps)


def misfit(columns: tuple[Array, Array, Array], positions: Array) -> Array:
    """
    Return listed minus computed positions, both counted from the first station, shape (n, 3), m.

    columns: measured depth, m, inclination and azimuth, rad. Raises ValueError if they do not make a path.
    """
    md, inc, azi = columns
    computed = mc.path(md, inc, azi)
    origin = positions[0]
    return np.asarray((positions - origin) - (computed - computed[0]))


def fits(columns: tuple[Array, Array, Array], positions: Array) -> bool:
    """
    Return whether the positions in a list agree with the path computed from its angles.

    Missing positions are not compared; the result is false if no path can be computed.
    """
    try:
        difference = misfit(columns, positions)
    except ValueError:
        return False
    compared = np.isfinite(difference)
    return bool(np.all(np.abs(np.where(compared, difference, 0.0)) <= allowed(columns[0])[:, None]))


def check_positions(name: str, columns: tuple[Array, Array, Array], positions: Array, at: Sequence[str]) -> None:
    """
    Refuse a list whose own positions contradict its angles.

    Raises
    ------
    ListFileError
        A position is not on the Earth, listed and computed positions differ too much, or units are mixed; the message
        names the likely cause.
    """
    for k, axis in zip(*np.nonzero(np.abs(positions) > _FARTHEST), strict=True):
        raise ListFileError(
            f"{at[k]}: {POSITION[axis]} {positions[k, axis]:g} m is farther away than any place on the Earth; check the"
            " unit and the decimal mark"
        )
    try:
        difference = misfit(columns, positions)
    except ValueError as error:
        raise ListFileError(f"{name}: {error}") from error
    for k, axis in zip(*np.nonzero(np.abs(difference) > allowed(columns[0])[:, None]), strict=True):
        given = positions[k, axis]
        raise ListFileError(
            f"{at[k]}: {POSITION[axis]} {given:.2f} m does not fit the angles, which give"
            f" {given - difference[k, axis]:.2f} m; {_cause(columns, positions)}"
        )
    _check_units(name, columns, positions, difference)


def _check_units(name: str, columns: tuple[Array, Array, Array], positions: Array, difference: Array) -> None:
    """
    Refuse mixed length units in a nearly vertical hole, whose horizontal misfit is smaller than `allowed`.

    Raises ListFileError if north and east fit far better if the depths are converted from feet to metres, or from
    metres to feet.
    """
    apart = _sideways(difference)
    if not apart > _NOTICED:
        return
    md, inc, azi = columns
    for factor, words in (
        (0.3048, "depths in feet and north and east in metres"),
        (1.0 / 0.3048, "depths in metres and north and east in feet"),
    ):
        other = _sideways(misfit((md * factor, inc, azi), positions))
        if other < _CLEARLY * apart:
            raise ListFileError(
                f"{name}: north and east are up to {apart:.2f} m from the positions that the angles give, but only"
                f" {other:.2f} m with {words}; write the unit into the name of each column, such as MD (ft) and X (m)"
            )


def _sideways(difference: Array) -> float:
    """Return the largest horizontal part of position differences, m; 0 if north and east are not known."""
    return float(np.nanmax(np.hypot(difference[:, 0], difference[:, 1]), initial=0.0))


def turn_between(columns: tuple[Array, Array, Array], positions: Array) -> float:
    """
    Return the rotation of the azimuths, rad, that aligns the computed path with the listed north and east.

    The result is nan if no path can be computed, or if north and east are missing or almost zero.
    """
    md, inc, azi = columns
    try:
        computed = mc.path(md, inc, azi)
    except ValueError:
        return math.nan
    own, ours = positions[:, :2] - positions[0, :2], computed[:, :2] - computed[0, :2]
    good = np.all(np.isfinite(own), axis=1)
    if not np.any(good):
        return math.nan
    z_own, z_ours = own[good, 0] + 1j * own[good, 1], ours[good, 0] + 1j * ours[good, 1]
    total = np.sum(z_own * np.conj(z_ours))
    return float(np.angle(total)) if abs(total) > 1.0 else math.nan


def _cause(columns: tuple[Array, Array, Array], positions: Array) -> str:
    """Return the usual mistake that explains a contradiction, or advice on what to check."""
    md, inc, azi = columns
    turn = turn_between(columns, positions)
    right, up, foot = math.pi / 2.0, np.array([1.0, 1.0, -1.0]), 0.3048
    flat, deep = np.array([foot, foot, 1.0]), np.array([1.0, 1.0, foot])
    degrees = 180.0 / math.pi
    dips = "the inclinations are angles from the horizontal (dips): name the column dip"
    mixed = "feet and metres are mixed; write the unit into the name of each column, such as MD (ft) and X (m):"
    turned = (
        "azimuths and the north and east columns are from different norths: the columns are turned by"
        f" {math.degrees(turn):+.2f} deg"
    )
    # For each mistake: its name for the message, and the angles and positions without the mistake.
    ways = (
        (dips, (md, right - inc, azi), positions),
        (f"{dips}; positive dips point up", (md, right + inc, azi), positions),
        ("the angles are in radians: --angle-unit rad", (md, inc * degrees, azi * degrees), positions),
        ("the inclinations are in radians: give them a unit", (md, inc * degrees, azi), positions),
        ("the angles are in grads: --angle-unit grad", (md, inc * 0.9, azi * 0.9), positions),
        ("the angles are in degrees and not in grads", (md, inc / 0.9, azi / 0.9), positions),
        (f"{mixed} the measured depths are in feet, or the positions in metres", (md * foot, inc, azi), positions),
        (f"{mixed} the measured depths are in metres, or the positions in feet", (md / foot, inc, azi), positions),
        (f"{mixed} north and east are in feet and the other lengths in metres", columns, positions * flat),
        (f"{mixed} north and east are in metres and the other lengths in feet", columns, positions / flat),
        (f"{mixed} the vertical depths are in feet and the other lengths in metres", columns, positions * deep),
        (f"{mixed} the vertical depths are in metres and the other lengths in feet", columns, positions / deep),
        ("inclination and azimuth are exchanged", (md, azi, inc), positions),
        ("north and east are exchanged", columns, positions[:, [1, 0, 2]]),
        ("the vertical depths are elevations, which count upwards", columns, positions * up),
        (turned, (md, inc, azi + turn), positions),
    )
    for words, changed, moved in ways:
        angles = changed[1:]
        if np.all(np.isfinite(angles)) and np.all((angles[0] >= 0.0) & (angles[0] <= math.pi)) and fits(changed, moved):
            return f"likely cause: {words}"
    return "check units, north, and whether columns are what their names say"
