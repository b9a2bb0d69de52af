# SPDX-License-Identifier: Apache-2.0
"""
Collector of the live state of a well from its messages.

Samples go to the methods `on_...`, every other part of the state is set by `show`; `LiveState.at` returns the state at
a time. Nothing here reads a clock: every call takes `now`, s, of one steady clock.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import NANOSECONDS, RIG_VALID
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.live.inputs import SONDE
from mwd_surface.live.latest_values import Freshness, LatestValues, LiveValue, Quantity, StreamState, StripHistory
from mwd_surface.live.link_state import LinkStatus
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.toolface import ToolfaceReading, ToolfaceSelector
from mwd_surface.live.well_state import (
    Advisory,
    Angle,
    AttitudeState,
    Change,
    Chart,
    DialReading,
    DrillingState,
    RigState,
    ToolfaceState,
    WellState,
)
from mwd_surface.signals.table import page_fields
from mwd_surface.trajectory.advice import AdviceMode

_SECTIONS = {section: page_fields(section) for section in ("attitude", "toolface", "drilling", "rig")}
_QUANTITIES = {
    signal.name: Quantity(signal.unit, signal.source) for part in _SECTIONS.values() for signal in part.values()
}
_WITHHELD = math.radians(45.0)  # sigma of an angle above which the angle is not shown, rad
# Number of toolfaces on the dial, and shortest time between two of them, s. Readings arrive with jitter, so that one
# that is 5 % early is accepted.
_READINGS, _SPACING = 12, 0.95
_HISTORY_HZ, _TREND_HZ = 1.0, 1.0 / 30.0  # points per second on the strip charts and on the long charts
# Plausible temperatures, degC: from a tool stored outside in winter to more than the hottest electronics in use.
_COLDEST, _HOTTEST = -60.0, 250.0
_ANGLES = tuple(signal.name for signal in _SECTIONS["attitude"].values())
_PART_OF = {signal.name: part for part, signals in _SECTIONS.items() for signal in signals.values()}
# Field of rig/state -> name of the value.
_RIG = {signal.field: signal.name for signal in _SECTIONS["rig"].values()}
# Charts over time, and how several values within one interval are combined.
_HISTORY = {
    "vibration": "max",
    "rotary_speed": "mean",
    "stick_slip": "max",
    "axial_vibration": "max",
    "lateral_vibration": "max",
    "shocks": "max",
    "temperature": "mean",
    "total_field": "mean",
    "axial_interference": "mean",
    "inclination": "mean",
    "azimuth": "angle",
    "pressure": "mean",
    "flow": "mean",
    "top_drive_speed": "mean",
    "top_drive_torque": "max",
    "weight_on_bit": "mean",
    "hookload": "mean",
    "rate_of_penetration": "mean",
    "bit_depth": "mean",
    "doubt": "max",
}
# Charts over the depth of the sensor while a hole is drilled, and how values within one depth step are combined.
_LOGGED = {
    "inclination": "mean",
    "azimuth": "angle",
    "vibration": "max",
    "rotary_speed": "mean",
    "stick_slip": "max",
    "shocks": "max",
    "doubt": "max",
}
_STREAMS = ("sonde", "estimator", "magnetometer", "temperature", "interference", "dynamics", "rig", "recorder")
# Status bits that make an interval of the charts doubtful (1) or bad (2).
_DOUBTFUL = Status.CLIPPED | Status.ALIASED | Status.MAG_DISTURBED | Status.NO_MAG | Status.REJECTED
_BAD = Status.SENSOR_FAULT | Status.SENSOR_SUSPECT | Status.INITIALISING
# Status bit -> reason why a value is withheld, in order of precedence.
_WHY = (
    (Status.SENSOR_FAULT, "sensor faulty"),
    (Status.SENSOR_SUSPECT, "sensor in doubt: wait"),
    (Status.INITIALISING, "estimator settling"),
    (Status.NEAR_VERTICAL, "not defined this near to vertical"),
    (Status.NO_MAG, "no magnetometer"),
)


# Reason for a value that arrived without sigma and is therefore withheld.
_NOT_KNOWN = "not known now"


class LiveState:
    """
    Collector of the state of one well.

    Methods `on_...` take samples, at least one; angles and times as in the messages. A number that is not finite is
    left out and does not count as an update. This class is not thread-safe: make all calls from one thread. A state
    returned by `at` does not change and may be read in any thread.
    """

    def __init__(self, settings: LiveSettings | None = None) -> None:
        self.settings = settings or LiveSettings()
        self.toolface_reading: ToolfaceReading | None = None
        self._selector = ToolfaceSelector()
        periods = {name: float(getattr(self.settings, f"{name}_period")) for name in _STREAMS}
        self._values = LatestValues(_QUANTITIES, periods)
        self._readings: deque[DialReading] = deque(maxlen=_READINGS)
        self._history = StripHistory(_HISTORY, self.settings.history_seconds, _HISTORY_HZ)
        self._trend = StripHistory(_HISTORY, self.settings.trend_hours * 3600.0, _TREND_HZ)
        self._log = StripHistory(_LOGGED, self.settings.log_length, 1.0 / self.settings.log_step)
        self._log_depth: float | None = None
        self._sample: Samples | None = None
        self._vertical_limit: float | None = None
        self._in_slips: bool | None = None
        self._changes: dict[str, Change] = {}
        #: State with the parts that `show` has set; parts that are computed from samples have their defaults.
        self.parts = WellState()
        # For each angle that arrives over a link: time of measurement, s, and the same on the clock of the gauge, ns.
        self._words: dict[str, tuple[float, int]] = {}
        #: Function that returns the time at which a sample was measured, s of the steady clock. Its arguments are the
        #: clock that stamped the sample (sonde or rig), its stamp, ns, and the time of its arrival, s.
        self.moment: Callable[[str, int, float], float] = _when_it_came
        self._measured_at: float | None = None

    def show(self, now: float, **parts: Any) -> None:
        """
        Set parts of the state: fields of `WellState` by name.

        Raises
        ------
        TypeError
            `WellState` has no field of that name.
        """
        self.parts = dataclasses.replace(self.parts, **parts)
        for name in parts:
            self._touch(name, now)

    def on_link(self, link: LinkStatus, now: float) -> None:
        """Accept the state of the telemetry link to the tool."""
        for name in ("inclination", "azimuth", "toolface"):
            age = getattr(link, f"{name}_age")
            # The age is NaN if the word was withdrawn; the shown value then keeps its time of measurement.
            if math.isfinite(age):
                self._words[name] = (link.at - age, link.stamp_ns - round(age * NANOSECONDS))
        self.show(now, link=link)

    def toolface_age(self, stamp_ns: int) -> float:
        """Return the age, s, of the word on which the toolface at a stamp, ns, is based; 0 without a link."""
        link = self.parts.link
        if link is None or math.isnan(link.toolface_age):
            return 0.0
        return max(link.toolface_age + (stamp_ns - link.stamp_ns) * 1e-9, 0.0)

    def on_recorder(self, status: RecorderStatus, now: float) -> None:
        """Accept the status of the recorder, and count it as a message of the stream `recorder`."""
        self.on_stream("recorder", 1, now)
        self.show(now, recorder=status)

    def on_stream(self, stream: str, count: int, now: float) -> None:
        """
        Count messages of a stream, for its rate and age.

        Raises
        ------
        ValueError
            The stream is unknown.
        """
        self._values.arrived(stream, count, now)

    def on_attitude(self, samples: Samples, now: float) -> None:
        """Accept attitudes, `wire.ATTITUDE`, oldest first, and select the toolface (`toolface_reading`)."""
        last = self._newest(samples, now, "estimator")
        self._sample = samples[-1:].copy()
        why = next((text for bit, text in _WHY if int(last["status"]) & bit), _NOT_KNOWN)
        for name in _ANGLES:
            self._angle(name, float(last[name]), float(last["sigma_" + name]), why, now)
            angle = self._values.updated(name, now)
            if angle is not None:
                self._chart(name, angle, now)
        every = int(np.bitwise_or.reduce(samples["status"]))
        self._chart("doubt", 2.0 if every & _BAD else 1.0 if every & _DOUBTFUL else 0.0, now)
        self._touch("attitude", now)
        speed = self._values.last("rotary_speed")
        reading = self._selector.update(samples, 0.0 if speed is None else speed)
        if reading is not None:
            self.on_toolface(reading, now, why)

    def on_toolface(self, reading: ToolfaceReading, now: float, why: str = "not available") -> None:
        """Accept a toolface; why is the reason to show if angle or sigma is not finite, or the sigma is too large."""
        self.toolface_reading = reading
        self._angle("toolface", reading.angle, reading.sigma, why, now)
        self._touch("toolface", now)
        value = self._values.updated("toolface", now)
        if value is None:
            return
        if self._readings and now - self._readings[-1].at < _SPACING:
            return
        self._readings.append(DialReading(value, reading.mode, now, reading.rotating, reading.stamp_ns))

    def on_gravity(self, samples: Samples, now: float) -> None:
        """Accept samples of `wire.GRAVITY`, of which the largest vibration and the last rotary speed are used."""
        known = samples[np.isfinite(samples["sigma"])]
        if len(known) == 0:
            return
        self._measured_at = self.moment(SONDE, int(known["stamp_ns"][-1]), now)
        self._put("vibration", float(np.max(known["non_gravity"])), None, now)
        self._put("rotary_speed", float(known["rotary_speed"][-1]), None, now)

    def on_dynamics(self, samples: Samples, now: float) -> None:
        """
        Accept summaries of drilling dynamics, `wire.DYNAMICS`; only the last one is used.

        If this one has no stick-slip index, the stick-slip is withheld with the reason "not turning".
        """
        last = self._newest(samples, now, "dynamics")
        if math.isfinite(last["stick_slip_index"]):
            self._put("stick_slip", float(last["stick_slip_index"]), None, now)
        else:
            self._withhold("stick_slip", "not turning", now)
        for name, field in (
            ("axial_vibration", "axial_rms"),
            ("lateral_vibration", "lateral_rms"),
            ("shocks", "shocks"),
            ("shock_peak", "shock_peak"),
            ("rotary_least", "rotary_speed_least"),
            ("rotary_most", "rotary_speed_most"),
        ):
            self._put(name, float(last[field]), None, now)

    def on_temperature(self, samples: Samples, now: float) -> None:
        """
        Accept temperatures of the sonde, degC, `wire.TEMPERATURE`; a variance of 0 means unknown.

        Only the last one is used; a temperature outside `_COLDEST` to `_HOTTEST` is withheld with a reason.
        """
        last = self._newest(samples, now, "sonde", "temperature")
        celsius, variance = float(last["temperature"]), float(last["variance"])
        if _COLDEST <= celsius <= _HOTTEST:
            self._put("temperature", celsius, math.sqrt(variance) if variance > 0.0 else None, now)
        else:
            self._withhold(
                "temperature", f"{celsius:.0f} degC is not plausible in a tool: check the temperature sensor", now
            )

    def on_magnetic_field(self, samples: Samples, now: float) -> None:
        """
        Accept magnetic fields, `wire.MAG`; the mean of their strengths is shown.

        The mean is withheld while the estimator reports that the magnetometer cannot be used.
        """
        self._newest(samples, now, "sonde", "magnetometer")
        totals = np.linalg.norm(samples["magnetic_field"], axis=1)
        if self._without_magnetometer(now):
            self._withhold("total_field", "no magnetometer", now)
        else:
            self._put("total_field", float(np.mean(totals)), None, now)

    def on_interference(self, samples: Samples, now: float) -> None:
        """Accept estimates of magnetic interference, `wire.INTERFERENCE`; only the last one is used."""
        last = self._newest(samples, now, "interference")
        axial, sigma = float(last["axial"]), float(last["sigma_axial"])
        across = np.asarray(last["cross_axial"], dtype=float)
        sigma_across = np.asarray(last["sigma_cross_axial"], dtype=float)
        self._put_observed("axial_interference", axial, sigma, now)
        self._put_observed("cross_axial_interference", float(np.hypot(*across)), float(np.min(sigma_across)), now)
        self._put("field_deviation", float(last["total_residual"]), None, now)
        self._put("dip_deviation", float(last["dip_residual"]), None, now)

    def on_rig_state(self, samples: Samples, now: float) -> None:
        """Accept rig data, `wire.RIG_STATE`; use the last sample, and only its valid fields."""
        last = self._newest(samples, now, "rig", clock="rig")
        valid = int(last["valid"])
        for field, name in _RIG.items():
            if valid & RIG_VALID[field]:
                self._put(name, float(last[field]), None, now)
        self._in_slips = bool(last["in_slips"]) if valid & RIG_VALID["in_slips"] else None

    def on_log_depth(self, depth: float | None) -> None:
        """
        Set the depth of the sensor, m, to which the next values belong; None while no hole is drilled.

        A depth that is negative or not finite counts as None.
        """
        self._log_depth = depth if depth is not None and math.isfinite(depth) and depth >= 0.0 else None
        if self._log_depth is not None:
            self._log.advance(self._log_depth)

    def on_vertical_limit(self, inclination: float | None) -> None:
        """Set the inclination, rad, below which the estimator gives the magnetic toolface."""
        if inclination != self._vertical_limit:
            self._vertical_limit = inclination
            self._touch("toolface")

    def at(self, now: float) -> WellState:
        """Return the state of the well at a time; now: steady time, s."""
        for strip in (self._history, self._trend):
            strip.advance(now)
        history, trend, depth_log = (
            Chart(s.columns, s.rows(), s.length) for s in (self._history, self._trend, self._log)
        )
        return dataclasses.replace(
            self.parts,
            now=now,
            attitude=self._attitude(now),
            toolface=self._toolface(now),
            drilling=DrillingState(**self._fields("drilling", now)),
            rig=self.rig(now),
            streams=self.streams(now),
            history=history,
            trend=trend,
            depth_log=depth_log,
            changes=dict(self._changes),
        )

    def rig(self, now: float) -> RigState:
        """Return the measurements of the rig at `now`; slips are not known after the rig data have stopped."""
        comes = self.streams(now)["rig"].state == Freshness.LIVE
        return RigState(**self._fields("rig", now), in_slips=self._in_slips if comes else None)

    def streams(self, now: float) -> dict[str, StreamState]:
        """Return the state of each stream at `now`, by name."""
        return self._values.streams(now)

    def _newest(self, samples: Samples, now: float, *streams: str, clock: str = SONDE) -> Any:
        """Count samples in their streams, and return the last one; the next values were measured at its stamp."""
        for stream in streams:
            self.on_stream(stream, len(samples), now)
        last = samples[-1]
        self._measured_at = self.moment(clock, int(last["stamp_ns"]), now)
        return last

    def _attitude(self, now: float) -> AttitudeState:
        inclination, azimuth = (self._value(name, now) for name in _ANGLES)
        if self._sample is None:
            return AttitudeState(inclination, azimuth)
        last = self._sample[0]
        return AttitudeState(
            inclination,
            azimuth,
            gravity_toolface=_angle(last, "gravity_toolface"),
            magnetic_toolface=_angle(last, "magnetic_toolface"),
            status=Status(int(last["status"])),
            north=North(int(last["north"])) if int(last["north"]) in list(North) else North.UNKNOWN,
            stamp_ns=int(last["stamp_ns"]),
        )

    def _toolface(self, now: float) -> ToolfaceState:
        angle, reading = self._value("toolface", now), self.toolface_reading
        advisory = self._advisory(angle)
        if reading is None:
            return ToolfaceState(angle, self._selector.mode, advisory=advisory, threshold=self._vertical_limit)
        return ToolfaceState(
            angle=angle,
            mode=reading.mode,
            rotating=reading.rotating,
            stamp_ns=reading.stamp_ns,
            measured_ns=self._words["toolface"][1] if "toolface" in self._words else reading.stamp_ns,
            readings=tuple(self._readings),
            advisory=advisory,
            threshold=self._vertical_limit,
        )

    def _advisory(self, angle: LiveValue) -> Advisory | None:
        """
        Return the advised toolface of a slide, its limit, and whether the toolface in force is within this limit.

        None if the advice is not a slide, or its toolface is unknown.
        """
        advice = self.parts.advice
        toolface, limit = advice.toolface, abs(advice.limit)
        if advice.mode != AdviceMode.SLIDE or not math.isfinite(toolface + limit):
            return None
        inside = None
        if angle.state == Freshness.LIVE and angle.value is not None:
            inside = abs(math.remainder(angle.value - toolface, math.tau)) <= limit
        return Advisory(toolface % math.tau, limit, inside)

    def _value(self, name: str, now: float) -> LiveValue:
        """Return a value; an angle that came over a link has the time at which its word was measured."""
        value = self._values.value(name, now)
        if value.value is None or name not in self._words:
            return value
        return dataclasses.replace(value, measured_at=self._words[name][0])

    def _without_magnetometer(self, now: float) -> bool:
        """Return whether the estimator is live and reports that the magnetometer cannot be used."""
        if self._sample is None or self._values.streams(now)["estimator"].state != Freshness.LIVE:
            return False
        return bool(int(self._sample[0]["status"]) & Status.NO_MAG)

    def _fields(self, section: str, now: float) -> dict[str, LiveValue]:
        return {signal.field: self._value(signal.name, now) for signal in _SECTIONS[section].values()}

    def _angle(self, name: str, value: float, sigma: float, why: str, now: float) -> None:
        if not math.isfinite(value + sigma):
            self._withhold(name, why, now)
        elif sigma > _WITHHELD:
            self._withhold(name, f"sigma {math.degrees(sigma):.0f} deg" if why == _NOT_KNOWN else why, now)
        else:
            self._put(name, value, sigma, now)

    def _put_observed(self, name: str, value: float, sigma: float, now: float) -> None:
        if math.isfinite(value + sigma):
            self._put(name, value, sigma, now)
        else:
            self._withhold(name, "not observable yet", now)

    def _put(self, name: str, value: float, sigma: float | None, now: float) -> None:
        if not math.isfinite(value):
            return
        self._values.put(name, value, sigma, now, self._measured_at)
        self._touch(_PART_OF[name], now)
        if name not in _ANGLES:
            self._chart(name, value, now)

    def _chart(self, name: str, value: float, now: float) -> None:
        if name in _HISTORY:
            self._history.add(name, value, now)
            self._trend.add(name, value, now)
        if name in _LOGGED and self._log_depth is not None:
            self._log.add(name, value, self._log_depth)

    def _withhold(self, name: str, why: str, now: float) -> None:
        if self._values.withhold(name, why):
            self._touch(_PART_OF[name], now)

    def _touch(self, part: str, now: float | None = None) -> None:
        before = self._changes.get(part, Change())
        self._changes[part] = Change(before.count + 1, before.at if now is None else now)


def _when_it_came(_clock: str, _stamp_ns: int, now: float) -> float:
    return now


def _angle(sample: Any, name: str) -> Angle | None:
    value, sigma = float(sample[name]), float(sample["sigma_" + name])
    if not math.isfinite(value + sigma):
        return None
    return Angle(value % math.tau, sigma)
