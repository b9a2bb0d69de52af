# SPDX-License-Identifier: Apache-2.0
"""
External magnetic field (ionosphere, magnetosphere, storms) from the record of an observatory.

A magnetic reference describes the fields of core and crust. The external field, which the Sun causes, is measured at
observatories; its difference from the quiet level is nearly the same at a well a few hundred kilometres away. Format:
IAGA-2002 data exchange format (IAGA Division V, documented by NOAA/NCEI). Method: S. J. Reay et al., "Space weather
effects on drilling accuracy in the North Sea", Annales Geophysicae 23 (2005), 3081-3088, which measured the error that
remains after such a correction.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
import re
from pathlib import Path

import numpy as np

from mwd_estimation.core.reference_field import ExternalField, Reference
from mwd_estimation.settings.place import Place
from mwd_sensors.core import budgets
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.foreign_text import contents_hidden
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.core.input_files import read_file
from mwd_sensors.core.settings import SettingsError

# Smallest value, nT or minutes of arc, that is a null value of IAGA-2002: 99999 for missing, 88888 for not recorded.
_MISSING = 88888.0
# Null values, and a full circle in tenths of minutes of arc, of DECBAS.
_NULLS, _CIRCLE = (88888.0, 99999.0), 216000.0
# Longest gap over which the record is interpolated, s: pulsations and substorm onsets take minutes.
_LONGEST_GAP = 600.0
# Hours in which the range of the field is smaller than this are equally quiet, T: observatories report tenths of nT.
_RESOLUTION = 1e-9
_HOUR_NS = 3_600_000_000_000
# Minute of arc, rad: the unit of declination and dip, and ten times the unit of DECBAS.
_MINUTE = math.radians(1.0 / 60.0)


@dataclasses.dataclass(frozen=True)
class ObservatoryRecord:
    """Field at an observatory over time."""

    station: str  #: IAGA code of the observatory
    stamps_ns: Stamps  #: shape (n,); UTC, ns, increasing
    field_n: Array  #: shape (n, 3); north, east, down (geographic), T; only complete samples
    quiet_n: Array  #: shape (3,); quiet level, T

    def disturbance(self, stamp_ns: int) -> Array | None:
        """
        Return the difference of the field from the quiet level at a time: north, east, down, T, shape (3,).

        stamp_ns: UTC. Returns None in a gap or outside the record.
        """
        after = int(np.searchsorted(self.stamps_ns, stamp_ns))
        if after < len(self.stamps_ns) and self.stamps_ns[after] == stamp_ns:
            return np.asarray(self.field_n[after] - self.quiet_n)
        if not 0 < after < len(self.stamps_ns):
            return None
        first, second = int(self.stamps_ns[after - 1]), int(self.stamps_ns[after])
        if (second - first) * 1e-9 > _LONGEST_GAP:
            return None
        share = (stamp_ns - first) / (second - first)
        between = (1.0 - share) * self.field_n[after - 1] + share * self.field_n[after]
        return np.asarray(between - self.quiet_n)


def read_iaga2002(text: str, name: str) -> ObservatoryRecord:
    """
    Return the record of a file in IAGA-2002 format with components X, Y, Z, or H, D, Z, or H, E, Z, or D, I, F.

    Other components are ignored. Several daily files may be joined, each with its own header. The baseline declination
    (DECBAS) of a header is added to the angles that variometers report relative to the baseline.

    Parameters
    ----------
    text : str
        Content of the file.
    name : str
        Name of the file, for errors.

    Raises
    ------
    ValueError
        If there is no IAGA-2002 header of columns, the components are not one of these sets, H and E have no baseline
        declination, there are several observatories, a line cannot be read, or there are fewer than two complete
        samples.
    """
    sections = _sections(text, name)
    stations = list(dict.fromkeys(section.station for section in sections))
    if len(stations) > 1:
        raise ValueError(
            f"{name}: records of several observatories ({', '.join(stations)}); give a file of one of them"
        )
    stamps_ns = np.array([stamp for section in sections for stamp in section.stamps_ns], dtype=np.int64)
    field_n = np.concatenate([section.north_east_down(name) for section in sections])
    whole = np.isfinite(field_n).all(axis=1)
    stamps_ns, first = np.unique(stamps_ns[whole], return_index=True)
    field_n = field_n[whole][first]
    if len(stamps_ns) < 2:
        raise ValueError(f"{name}: {len(stamps_ns)} complete samples of all components, at least 2 are needed")
    return ObservatoryRecord(stations[0], stamps_ns, field_n, quiet_level(stamps_ns, field_n))


@dataclasses.dataclass
class _Section:
    """A header and the data after it."""

    station: str  #: IAGA code of the observatory
    letters: list[str]  #: letter of each component, in the order of the columns
    baseline: float | None  #: baseline declination, rad; None if the header has none
    stamps_ns: list[int] = dataclasses.field(default_factory=list)
    rows: list[list[float]] = dataclasses.field(default_factory=list)

    def north_east_down(self, name: str) -> Array:
        """
        Return the samples as north, east, down, T, shape (n, 3); NaN for a null value.

        Raises ValueError as `read_iaga2002`; name: name of the file, for the errors.
        """
        raw = np.array(self.rows, dtype=float).reshape(len(self.rows), len(self.letters))
        raw[np.abs(raw) >= _MISSING] = math.nan
        have = {letter: raw[:, k] for k, letter in enumerate(self.letters)}
        if {"X", "Y", "Z"} <= have.keys():
            return 1e-9 * np.column_stack([have["X"], have["Y"], have["Z"]])
        if {"H", "D", "Z"} <= have.keys():
            horizontal, down, declination = have["H"], have["Z"], have["D"] * _MINUTE
        elif {"H", "E", "Z"} <= have.keys():
            if self.baseline is None:
                raise ValueError(
                    f"{name}: components {', '.join(self.letters)} need the baseline declination, and no header has a "
                    "line # DECBAS; ask the observatory for X, Y, Z"
                )
            horizontal, down = np.hypot(have["H"], have["E"]), have["Z"]
            declination = np.arctan2(have["E"], have["H"]) + self.baseline
        elif {"D", "I", "F"} <= have.keys():
            dip, declination = have["I"] * _MINUTE, have["D"] * _MINUTE
            horizontal, down = have["F"] * np.cos(dip), have["F"] * np.sin(dip)
        else:
            letters = ", ".join(sorted(have))
            raise ValueError(f"{name}: components {letters} are not X, Y, Z nor H, D, Z nor H, E, Z nor D, I, F")
        if "D" in have and self.baseline is not None and not np.isnan(declination).all():
            # Some files give the full declination, others the angle of a variometer from its baseline. If the median
            # angle is nearer to zero than to the baseline, it is the angle of a variometer: add the baseline.
            middle = float(np.nanmedian(declination))
            if abs(wrap_pi(middle)) < abs(wrap_pi(middle - self.baseline)):
                declination = declination + self.baseline
        return 1e-9 * np.column_stack([horizontal * np.cos(declination), horizontal * np.sin(declination), down])


def _sections(text: str, name: str) -> list[_Section]:
    """Split a file at its headers; return each header with the data after it. Raises ValueError as `read_iaga2002`."""
    sections: list[_Section] = []
    baseline: float | None = None
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("DATE "):
            columns = line.replace("|", " ").split()[3:]
            letters = [column[3:4].upper() for column in columns]
            sections.append(_Section(columns[0][:3] if columns else "", letters, baseline))
            baseline = None
        elif found := re.match(r"\s*#\s*DECBAS\s+([-+]?\d+(?:\.\d*)?)", line):
            # DECBAS is in tenths of a minute of arc, positive east, at most a full circle. The null values of the data
            # are null values of DECBAS too.
            tenths = float(found[1])
            known = abs(tenths) <= _CIRCLE and tenths not in _NULLS
            baseline = float(wrap_pi(0.1 * tenths * _MINUTE)) if known else None
        elif sections and line[:1].strip():
            try:
                stamp, values = _sample(line, len(sections[-1].letters))
            except ValueError as error:
                raise ValueError(f"{name}, line {number}: not a line of IAGA-2002 data: {line[:40]!r}") from error
            sections[-1].stamps_ns.append(stamp)
            sections[-1].rows.append(values)
    if not sections:
        raise ValueError(f"{name}: not an IAGA-2002 file: no line with the columns DATE TIME DOY and the components")
    return sections


def quiet_level(stamps_ns: Stamps, field_n: Array) -> Array:
    """
    Return the quiet level of a record: the median of its samples, with larger weights for samples of quiet hours.

    Parameters
    ----------
    stamps_ns : ndarray, shape (n,)
        Stamps, increasing.
    field_n : ndarray, shape (n, 3)
        Field, T.

    Returns
    -------
    ndarray, shape (3,)
        Field, T. The weight of a sample is the inverse square of the range of the field within its hour, so that even a
        storm that fills most of a record has little weight, and quiet nights have most of the weight.
    """
    hours = stamps_ns // _HOUR_NS
    _, starts, counts = np.unique(hours, return_index=True, return_counts=True)
    spread = np.maximum.reduceat(field_n, starts) - np.minimum.reduceat(field_n, starts)
    weight = 1.0 / (np.sum(spread**2, axis=1) + _RESOLUTION**2)
    # Ignore hours that a gap or an end of the record cuts short: their range is too small.
    weight[counts < 0.5 * np.median(counts)] = 0.0
    each = np.repeat(weight, counts)
    return np.array([_weighted_median(component, each) for component in field_n.T])


def _weighted_median(values: Array, weights: Array) -> float:
    """Return the weighted median of values, shape (n,): half of the total weight belongs to smaller values."""
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, 0.5 * below[-1])])


def with_external(reference: Reference, disturbance_n: Array, sigma_share: float, source: str) -> Reference:
    """
    Add the external field at one time to a reference.

    Parameters
    ----------
    reference : Reference
        Reference with field and declination; without both it is returned unchanged.
    disturbance_n : ndarray, shape (3,)
        Difference of the field from the quiet level: north (true), east, down, T.
    sigma_share : float
        1 sigma of the difference between the disturbances at well and observatory, as a share of the disturbance.
    source : str
        Name of the observatory, for the description of the reference.

    Returns
    -------
    Reference
        With `external`, and with the strength, dip and declination of the vector sum.
    """
    if reference.declination is None or not reference.has_field:
        return reference
    along = np.array([math.cos(reference.declination), math.sin(reference.declination)])
    north, east = reference.horizontal * along + disturbance_n[:2]
    down = reference.vertical + float(disturbance_n[2])
    horizontal = math.hypot(north, east)
    total, strength = math.hypot(horizontal, down), float(np.linalg.norm(disturbance_n))
    # The difference between well and observatory may have any direction. Its three components are along the field,
    # across the field in the meridian, and east.
    left = sigma_share * strength / math.sqrt(3.0)
    return dataclasses.replace(
        reference,
        total=total,
        dip=math.atan2(down, horizontal),
        declination=math.atan2(east, north),
        source=f"{reference.source}, external field of {source}",
        sigma_total=math.hypot(reference.sigma_total, left),
        sigma_dip=math.hypot(reference.sigma_dip, left / total),
        sigma_declination_field=math.hypot(reference.sigma_declination_field, left),
        external=ExternalField((float(disturbance_n[0]), float(disturbance_n[1]), float(disturbance_n[2]))),
    )


def _sample(line: str, components: int) -> tuple[int, list[float]]:
    """Return UTC, ns, and the components of one line of data; raise ValueError if the line cannot be read."""
    day, clock, _, *values = line.replace("|", " ").split()
    if len(values) != components:
        raise ValueError(line)
    moment = datetime.datetime.fromisoformat(f"{day}T{clock}").replace(tzinfo=datetime.UTC)
    whole = int(moment.replace(microsecond=0).timestamp())
    return whole * 1_000_000_000 + moment.microsecond * 1000, [float(value) for value in values]


# External field from the observatory file in the settings, which is read again whenever the file has changed.


class Observatory:
    """
    External field at the time of each survey.

    place : Place
        If its `observatory_file` is empty, every reference is returned unchanged.

    Raises
    ------
    SettingsError
        If the file cannot be read, or is not an IAGA-2002 record.
    """

    def __init__(self, place: Place) -> None:
        self._place = place
        self._read_at: tuple[int, int] | None = None
        self._record: ObservatoryRecord | None = None
        if place.observatory_file:
            try:
                with contents_hidden(place.observatory_file):
                    self._refresh()
            except SettingsError as error:
                raise SettingsError(f"place.observatory_file: {error}; expected a file of IAGA-2002") from None

    def at(self, reference: Reference | None, stamp_ns: int | None) -> Reference | None:
        """
        Return the reference with the external field at a time, UTC, ns; None: unknown time.

        At an unknown time, or where the record has no data, only the name of the observatory is added. Without a
        record, or if the reference has no field or no declination, the reference is returned unchanged.
        """
        if self._record is None or reference is None or not reference.has_field or reference.declination is None:
            return reference
        try:
            self._refresh()
        except (OSError, ValueError):
            # The file is being written: keep the last record; `survey.verdict` reports a time after its end.
            self._read_at = None
        found = None if stamp_ns is None else self._record.disturbance(stamp_ns)
        asked = dataclasses.replace(reference, observatory=self._record.station)
        if found is None:
            return asked
        return with_external(asked, found, self._place.observatory_share, f"observatory {self._record.station}")

    def _refresh(self) -> None:
        path = Path(self._place.observatory_file)
        status = path.stat()
        now = (status.st_mtime_ns, status.st_size)
        if now != self._read_at:
            self._record = read_iaga2002(read_file(path, budgets.OBSERVATORY).decode(errors="replace"), path.name)
            self._read_at = now
