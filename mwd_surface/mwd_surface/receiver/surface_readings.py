# SPDX-License-Identifier: Apache-2.0
"""Tables of field strength on the surface, the attitude that a sonde sent, and the located sonde in words."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mwd_sensors.core import budgets
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.input_files import read_text
from mwd_sensors.telemetry import meanings
from mwd_surface.list_files.table import read_table
from mwd_surface.receiver.sonde_locate import SondeFix, SurfaceReadings, locate_points, moment_of
from mwd_surface.receiver.words import BELIEVED, BY_CONSISTENCY

_POINT = ("north_m", "east_m")
_FIELD = ("b_north_nt", "b_east_nt", "b_down_nt")
_STRENGTH = "strength_nt"
_NT = 1e-9


@dataclasses.dataclass(frozen=True)
class SentAttitude:
    """Attitude that a sonde sent; pitch above the horizontal and roll (toolface), rad, NaN if unknown."""

    pitch: float = math.nan
    roll: float = math.nan


def read(path: Path) -> SurfaceReadings:
    """
    Return the readings in a table.

    Parameters
    ----------
    path : Path
        Columns north_m, east_m, down_m (0 if there is none), and b_north_nt, b_east_nt, b_down_nt or strength_nt.

    Raises
    ------
    ValueError
        A column is missing, or a cell is not a number.
    """
    columns = read_table(path).columns()
    have = {name.strip().lower(): cells for name, cells in columns.items()}
    vectors = all(name in have for name in _FIELD)
    missing = [name for name in (*_POINT, *(() if vectors else (_STRENGTH,))) if name not in have]
    if missing:
        raise ValueError(
            f"{path}: the table has no column {', '.join(missing)}; it must have north_m, east_m, and either"
            f" strength_nt or {', '.join(_FIELD)}"
        )
    count = len(have[_POINT[0]])
    down = _numbers(path, have, "down_m") if "down_m" in have else np.zeros(count)
    point = np.column_stack([*(_numbers(path, have, name) for name in _POINT), down])
    nothing = np.full(count, math.nan)
    field = np.column_stack([_NT * _numbers(path, have, name) if vectors else nothing for name in _FIELD])
    strength = _NT * _numbers(path, have, _STRENGTH) if _STRENGTH in have else nothing
    return SurfaceReadings(point, field, strength)


def _numbers(path: Path, columns: Mapping[str, list[str]], name: str) -> Array:
    """Return a column as numbers, NaN for an empty cell; ValueError for a cell with a text."""
    found = []
    for row, cell in enumerate(columns[name]):
        try:
            found.append(float(cell) if cell.strip() else math.nan)
        except ValueError as error:
            raise ValueError(f'{path}: "{cell}" in row {row + 1} of {name} is not a number') from error
    return np.array(found)


def sent_attitude(path: Path) -> SentAttitude:
    """
    Return the last usable inclination, as pitch, and toolface in a table of words that `mwd decode` wrote.

    Raises
    ------
    ValueError
        The table has no usable inclination; a toolface may be missing.
    """
    rows = list(csv.DictReader(read_text(path, budgets.LIST).splitlines()))
    pitch = roll = math.nan
    for row in rows:
        quantity, value = meanings.meaning_of(row.get("name") or ""), row.get("value") or ""
        if not value or row.get("status") not in (BELIEVED, BY_CONSISTENCY):
            continue
        if quantity in (meanings.INCLINATION, meanings.CONTINUOUS_INCLINATION):
            pitch = math.radians(90.0 - float(value))
        elif quantity in (meanings.TOOLFACE, meanings.GRAVITY_TOOLFACE):
            roll = math.radians(float(value))
    if math.isnan(pitch):
        raise ValueError(f"{path}: no inclination was received; give the pitch with --pitch")
    return SentAttitude(pitch, roll)


def calibrated(text: str) -> float:
    """
    Return the moment of a coil, A m^2, from `distance,strength` in m and nT.

    Raises
    ------
    ValueError
        The text is not two numbers above 0.
    """
    try:
        distance, strength = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ValueError(f'--calibrate {text}: write distance (m) and strength (nT), for example "3,18.5"') from error
    if not (0.0 < distance < math.inf and 0.0 < strength < math.inf):
        raise ValueError(f"--calibrate {text}: both numbers must be above 0")
    return moment_of(_NT * strength, distance)


def lines(fix: SondeFix, sent: SentAttitude) -> list[str]:
    """Return the located sonde and its other solutions as lines of text."""
    sigma = fix.sigma
    north, east, down = fix.position.tolist()
    degrees = np.degrees((fix.azimuth, sigma[3], fix.pitch, sigma[4]))
    found = [
        f"sonde: north {north:.2f} +-{sigma[0]:.2f} m, east {east:.2f} +-{sigma[1]:.2f} m",
        f"depth {down:.2f} +-{sigma[2]:.2f} m below down_m = 0",
        f"azimuth {degrees[0]:.1f} +-{degrees[1]:.1f} deg, pitch {degrees[2]:+.1f} +-{degrees[3]:.1f} deg",
        f"moment {fix.moment:.3g} A m^2 +-{100.0 * sigma[5]:.1f} %; chi-square {fix.chi2:.1f} of {fix.freedom}",
    ]
    if not math.isnan(sent.roll):
        found.append(f"roll {math.degrees(sent.roll) % 360.0:.0f} deg, as the sonde sent it")
    if down > 0.0 and abs(fix.pitch) < math.radians(60.0):
        for name, along in zip(("behind", "ahead"), locate_points(down, fix.pitch), strict=True):
            there = north + along * math.cos(fix.azimuth), east + along * math.sin(fix.azimuth)
            found.append(f"field vertical {name}: north {there[0]:.2f} m, east {there[1]:.2f} m ({along:+.2f} m along)")
    found += [
        f"another solution: north {one.position[0]:.2f} m, east {one.position[1]:.2f} m, depth {one.position[2]:.2f} m,"
        f" azimuth {math.degrees(one.azimuth):.1f} deg, pitch {math.degrees(one.pitch):+.1f} deg"
        for one in fix.others
    ]
    return found
