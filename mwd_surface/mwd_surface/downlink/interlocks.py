# SPDX-License-Identifier: Apache-2.0
"""Interlocks of the downlink: conditions before and while a command is sent, each with its message."""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

from mwd_sensors.core.units import LPM, RPM
from mwd_sensors.telemetry.downlink import ROTATION, Downlink, amplitude
from mwd_surface.downlink.settings import DownlinkSettings

_BAR = 1e5
_RIG_SILENT_S = 2.0  # largest age of the rig's data, s
_LINK_SILENT_S = 10.0  # largest age of the state of the link, s
_USUAL_S = 60.0  # time over which the median gives the usual pressure, s
# Exponent of the flow in the pressure loss of turbulent pipe flow (Blasius); pressure / flow^1.75 depends little on the
# flow.
_POWER = 1.75


class InterlockReadings(NamedTuple):
    """
    Present readings at the surface; None means unknown.

    Attributes
    ----------
    rig_age_s : float
        Age of the rig's data.
    flow, rotary_speed, pressure : float or None
        Flow, m^3/s; speed of the top drive, rad/s; standpipe pressure, Pa.
    link_locked : bool
        Whether words arrive over the link.
    link_age_s : float
        Age of the state of the link.
    no_control : str
        Reason why the rig does not accept set-points; empty if it accepts them.
    """

    rig_age_s: float = math.inf
    flow: float | None = None
    rotary_speed: float | None = None
    pressure: float | None = None
    in_slips: bool | None = None
    link_locked: bool = False
    link_age_s: float = math.inf
    survey_running: bool = False
    no_control: str = ""


# Readings of this size or larger are impossible on any rig: m^3/s, rad/s, Pa.
_MOST = {"flow": 1.0, "rotary_speed": 100.0, "pressure": 1e9}


def possible(readings: InterlockReadings) -> InterlockReadings:
    """Return the readings with impossible values replaced by None."""
    known: dict[str, Any] = {name: getattr(readings, name) for name in _MOST}
    for name, value in known.items():
        if value is not None and not abs(value) < _MOST[name]:
            known[name] = None
    return readings._replace(**known)


class StallWatch:
    """
    Detector of a stall of the mud motor: a rise of the pressure above its usual value at the same flow.

    share : smallest rise that counts as a stall, as a share of the usual value.
    stalled : whether the last reading shows a stall.
    """

    def __init__(self, share: float) -> None:
        self._share = share
        self._ratios: deque[tuple[float, float]] = deque()
        self.stalled = False

    def take(self, now: float, flow: float | None, pressure: float | None, least_flow: float) -> None:
        """
        Add a reading of flow, m^3/s, and pressure, Pa; now: steady time, s.

        If a reading is unknown or the flow is below least_flow, m^3/s, the earlier readings that give the usual
        pressure are cleared.
        """
        if flow is None or pressure is None or flow < least_flow:
            self._ratios.clear()
            self.stalled = False
            return
        ratio = pressure / flow**_POWER
        while self._ratios and self._ratios[0][0] < now - _USUAL_S:
            self._ratios.popleft()
        usual = sorted(one for _, one in self._ratios)
        self.stalled = len(usual) >= 10 and ratio > (1.0 + self._share) * usual[len(usual) // 2]
        if not self.stalled:
            self._ratios.append((now, ratio))


def medium_value(readings: InterlockReadings, downlink: Downlink) -> float | None:
    """Return the reading of the quantity that the downlink changes (speed or flow); None if unknown."""
    return readings.rotary_speed if downlink.medium == ROTATION else readings.flow


def words(value: float, downlink: Downlink) -> str:
    """Return a value of the quantity that the downlink changes as text, in r/min or l/min."""
    return f"{value / RPM:.0f} r/min" if downlink.medium == ROTATION else f"{value / LPM:.0f} l/min"


def blocked(
    readings: InterlockReadings, downlink: Downlink, settings: DownlinkSettings, *, stalled: bool, running: bool
) -> tuple[str, ...]:
    """
    Return the messages of the interlocks that fail.

    running: whether symbols are being sent. If so, the lock of the uplink is not checked, because the symbols may
    disturb the uplink, and only the present flow or speed is compared with its limits, not the lowest set-point.
    """
    rules = (
        (bool(readings.no_control), readings.no_control),
        (readings.rig_age_s > _RIG_SILENT_S, "no data from the rig for 2 s"),
        (
            readings.in_slips is None or readings.in_slips,
            "the string is in slips, or the rig does not report the slips",
        ),
        (stalled, "the motor stalls: the pressure is far above its usual value at this flow"),
        (
            readings.pressure is None or readings.pressure > settings.pressure_high_bar * _BAR,
            f"the standpipe pressure is above {settings.pressure_high_bar:g} bar, or unknown",
        ),
        (readings.survey_running, "a survey is being taken"),
        (
            not running and not (readings.link_locked and readings.link_age_s < _LINK_SILENT_S),
            "the link is not locked: the tool's answer would not be received",
        ),
    )
    found = [text for fails, text in rules if fails]
    return (*found, *_outside(readings, downlink, settings, running=running))


def _outside(
    readings: InterlockReadings, downlink: Downlink, settings: DownlinkSettings, *, running: bool
) -> list[str]:
    """Return messages for limits of flow or speed that are exceeded, or would be exceeded during the downlink."""
    value = medium_value(readings, downlink)
    medium = "rotary speed" if downlink.medium == ROTATION else "flow"
    if value is None:
        return [f"the {medium} is unknown"]
    limits = {
        True: (settings.speed_low_rpm * RPM, settings.speed_high_rpm * RPM),
        False: (settings.flow_low_lpm * LPM, settings.flow_high_lpm * LPM),
    }
    low, high = limits[downlink.medium == ROTATION]
    # While symbols are sent, allow a reading slightly below the lowest set-point.
    lowest = value * (1.0 + settings.tolerance) if running else value * amplitude(0, downlink)
    found = []
    if value > high:
        found.append(f"{medium} {words(value, downlink)} is above the limit of {words(high, downlink)}")
    if lowest < low:
        found.append(
            f"{medium} would go down to {words(lowest, downlink)}; the lowest allowed is {words(low, downlink)}"
        )
    if not running and value < downlink.least_value:
        least = words(downlink.least_value, downlink)
        found.append(f"{medium} {words(value, downlink)} is too low: the tool accepts commands from {least} on")
    return found
