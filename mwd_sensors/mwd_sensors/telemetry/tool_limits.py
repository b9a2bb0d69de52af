# SPDX-License-Identifier: Apache-2.0
"""
Limits of a tool: battery, times that the tool withstands temperature and vibration, parts and their calibration.

The limits are the section `health` of a tool configuration. Without a configuration the figures below are used and
count as assumed: they are typical of MWD kits and not from a data sheet.
"""

from __future__ import annotations

import dataclasses
import datetime
import itertools
import math

import numpy as np

from mwd_sensors.core.settings import setting
from mwd_sensors.telemetry.log_channels import SOURCES

Rows = tuple[tuple[float, float], ...]


def _check_rising(name: str, rows: Rows, *, least: float) -> None:
    if not rows or any(b[0] <= a[0] for a, b in itertools.pairwise(rows)):
        raise ValueError(f"{name}: at least one row is needed, and the first column must rise, got {list(rows)}")
    if not all(math.isfinite(x) and math.isfinite(y) and y > least for x, y in rows):
        raise ValueError(f"{name}: the second column must be finite and above {least:g}, got {list(rows)}")


@dataclasses.dataclass(frozen=True)
class Pack:
    """Capacity and currents of a battery, for tool configurations and for simulated sondes."""

    capacity_ah: float = setting(26.0, "Capacity of the new battery at 25 degC.", unit="A h", low=0.01, high=10000.0)
    by_temperature: Rows = setting(
        ((-20.0, 0.6), (25.0, 1.0), (100.0, 0.95), (150.0, 0.8)),
        "Share of the capacity that the battery gives at a temperature: rows of degC and share.",
    )
    active_a: float = setting(0.4, "Mean current while the pumps are on.", low=0.0, high=100.0)
    idle_a: float = setting(0.06, "Mean current while the pumps are off.", low=0.0, high=100.0)
    used_ah: float = setting(
        0.0, "Charge used before this run. Not needed for a tool that counts and sends its charge.", unit="A h", low=0.0
    )

    def __post_init__(self) -> None:
        """Raise ValueError if the temperatures do not rise or a share is not above 0."""
        _check_rising("by_temperature", self.by_temperature, least=0.0)

    def share(self, celsius: float) -> float:
        """Return the share of the capacity at a temperature, degC; outside the table, the share at its nearer end."""
        at, share = np.array(self.by_temperature, dtype=float).T
        return float(np.interp(celsius, at, share))


@dataclasses.dataclass(frozen=True)
class BatteryLimits(Pack):
    """Data of a tool's battery with their sigmas, and limits for alarms."""

    capacity_sigma: float = setting(
        0.05,
        "1 sigma of the capacity, as a share of the capacity: batteries of the same kind differ.",
        low=0.0,
        high=1.0,
    )
    current_sigma: float = setting(
        0.1, "1 sigma of active_a and idle_a, as a share of each current.", low=0.0, high=1.0
    )
    counter_sigma: float = setting(
        0.02, "1 sigma of the charge that the tool counts, as a share of this charge.", low=0.0, high=1.0
    )
    least_v: float = setting(
        0.0,
        "Voltage at which the tool stops working; below it an alarm is raised. It depends on the number of cells in "
        "series. 0: not known, no alarm.",
        low=0.0,
        high=1000.0,
    )
    warning_h: float = setting(24.0, "Remaining time below which an alarm is raised.", low=0.0, high=10000.0)


@dataclasses.dataclass(frozen=True)
class ExposureLimit:
    """Time that a tool withstands each level of a quantity."""

    hours: Rows = setting(
        doc="Rows of level, in the unit of the quantity, and time that the tool withstands this level, h."
    )

    def __post_init__(self) -> None:
        """Raise ValueError if the levels do not rise, or a time is not above 0 or grows with the level."""
        _check_rising("hours", self.hours, least=0.0)
        if any(b[1] > a[1] for a, b in itertools.pairwise(self.hours)):
            raise ValueError(f"hours: the time must not grow with the level, got {list(self.hours)}")

    def allowed_h(self, level: float) -> float:
        """
        Return the time that the tool withstands a level, h.

        The time is infinite below the first level and constant above the last level. Between two rows its logarithm is
        interpolated linearly.
        """
        if level < self.hours[0][0]:
            return math.inf
        at, hours = np.array(self.hours, dtype=float).T
        return math.exp(float(np.interp(level, at, np.log(hours))))


@dataclasses.dataclass(frozen=True)
class ToolPart:
    """Part of a tool, with its serial number and calibration."""

    serial_number: str = setting("", "Serial number.")
    calibrated: str = setting("", "Day of the last calibration, such as 2026-03-01; empty: not calibrated.")
    valid_days: int = setting(365, "Time for which a calibration is valid.", unit="d", low=1, high=10000)

    def __post_init__(self) -> None:
        """Raise ValueError if `calibrated` is neither empty nor a date."""
        if self.calibrated:
            try:
                datetime.date.fromisoformat(self.calibrated)
            except ValueError as error:
                raise ValueError(f"calibrated: {self.calibrated!r} is not a day such as 2026-03-01") from error

    def overdue_days(self, day: datetime.date) -> int:
        """Return the number of days since the calibration expired; 0 if it is valid or there is no calibration."""
        if not self.calibrated:
            return 0
        return max(0, (day - datetime.date.fromisoformat(self.calibrated)).days - self.valid_days)


#: Limits of a tool whose configuration states none; typical of MWD kits, in degC and m/s^2.
EXPOSURES = {
    "temperature": ExposureLimit(((125.0, 2000.0), (150.0, 500.0), (175.0, 20.0))),
    "lateral_vibration": ExposureLimit(((20.0, 100.0), (40.0, 20.0), (80.0, 1.0))),
    "axial_vibration": ExposureLimit(((20.0, 100.0), (40.0, 20.0), (80.0, 1.0))),
    "shock_peak": ExposureLimit(((500.0, 20.0), (1000.0, 2.0), (2000.0, 0.2))),
}


@dataclasses.dataclass(frozen=True)
class ToolLimits:
    """Limits and parts of a tool."""

    battery: BatteryLimits | None = setting(None, "The battery. If not given, typical values are assumed.")
    exposures: dict[str, ExposureLimit] = setting(
        {},
        "Time that the tool withstands each level, by quantity: temperature (degC), lateral_vibration, axial_vibration "
        "and shock_peak (m/s^2) or any other source of a log channel. If none is given, typical values are assumed.",
    )
    parts: dict[str, ToolPart] = setting({}, "Parts by name, with serial number and calibration.")

    def __post_init__(self) -> None:
        """Raise ValueError for an unknown quantity."""
        for name in self.exposures:
            if name not in SOURCES:
                raise ValueError(f"exposures.{name}: unknown quantity; choose one of {', '.join(SOURCES)}")
