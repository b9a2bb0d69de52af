"""
The page's single values, from the samples as they stream in: with sigma and age, or why withheld; their charts.

No clock here: every call takes `now`, s, of one steady clock.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np

from mwd_estimation.core.status import Status, words
from mwd_sensors.core.arrays import Samples
from mwd_surface.live.settings import LiveSettings
from mwd_surface.live.strip_history import StripHistory
from mwd_surface.live.toolface import ToolfaceReading, ToolfaceSelector
from mwd_surface.live.values import LIVE, LiveValues
from mwd_surface.page.plain import number
from mwd_surface.page.survey_panel import NORTH_WORDS

TOOLFACE_WORDS = ("gravity", "magnetic")

# Every single value: its unit and the stream it comes with.
_VALUES = {
    "inclination": ("rad", "estimator"),
    "azimuth": ("rad", "estimator"),
    "toolface": ("rad", "estimator"),
    "vibration": ("m/s^2", "estimator"),
    "rotary_speed": ("rad/s", "estimator"),
    "gravity_sigma": ("rad", "estimator"),
    "stick_slip": ("", "dynamics"),
    "axial_vibration": ("m/s^2", "dynamics"),
    "lateral_vibration": ("m/s^2", "dynamics"),
    "shocks": ("", "dynamics"),
    "shock_peak": ("m/s^2", "dynamics"),
    "rotary_least": ("rad/s", "dynamics"),
    "rotary_most": ("rad/s", "dynamics"),
    "temperature": ("degC", "temperature"),
    "total_field": ("T", "magnetometer"),
    "axial_interference": ("T", "interference"),
    "cross_axial_interference": ("T", "interference"),
    "field_deviation": ("T", "interference"),
    "dip_deviation": ("rad", "interference"),
    "bit_depth": ("m", "rig"),
    "hole_depth": ("m", "rig"),
    "block_position": ("m", "rig"),
    "hookload": ("N", "rig"),
    "weight_on_bit": ("N", "rig"),
    "torque": ("N m", "rig"),
    "rig_rotary_speed": ("rad/s", "rig"),
    "flow_rate": ("m^3/s", "rig"),
    "pressure": ("Pa", "rig"),
    "rate_of_penetration": ("m/s", "rig"),
}
# Bits of RigState.valid and the fields they vouch for, in order from 1.
_RIG_FIELDS = (
    "bit_depth", "hole_depth", "block_position", "hookload", "weight_on_bit", "torque", "rotary_speed", "flow_rate",
    "pressure", "rate_of_penetration",
)  # fmt: skip
_RIG_SLIPS = 1024
_DRILLING = (
    "vibration", "rotary_speed", "stick_slip", "axial_vibration", "lateral_vibration", "shocks", "shock_peak",
    "rotary_least", "rotary_most", "temperature", "total_field", "axial_interference", "cross_axial_interference",
    "field_deviation", "dip_deviation",
)  # fmt: skip
_RIG = tuple(name for name, (_, stream) in _VALUES.items() if stream == "rig")
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
    "doubt": "max",
}
# The same over the depth of the sensor while hole is made.
_LOGGED = {
    "inclination": "mean",
    "vibration": "max",
    "rotary_speed": "mean",
    "stick_slip": "max",
    "shocks": "max",
    "doubt": "max",
}
_STREAMS = ("sonde", "estimator", "magnetometer", "temperature", "interference", "dynamics", "rig", "recorder")
# What makes a stretch of the tracks doubtful (1) or bad (2).
_DOUBTFUL = Status.CLIPPED | Status.ALIASED | Status.MAG_DISTURBED | Status.NO_MAG | Status.REJECTED
_BAD = Status.SENSOR_FAULT | Status.SENSOR_SUSPECT | Status.INITIALISING
# What the status says about a value that is withheld.
_WHY = (
    (Status.SENSOR_FAULT, "a sensor is judged faulty"),
    (Status.SENSOR_SUSPECT, "something speaks against a sensor: wait a few seconds"),
    (Status.INITIALISING, "the estimator is still settling"),
    (Status.NEAR_VERTICAL, "not defined this near to vertical"),
    (Status.NO_MAG, "no usable magnetometer"),
)
_SECTION_OF = {
    name: "rig" if stream == "rig" else "attitude" if name in ("inclination", "azimuth") else "drilling"
    for name, (_, stream) in _VALUES.items()
} | {"toolface": "toolface"}


class LiveStreams:
    """
    Single values, charts and states of the streams.

    Methods `on_...` take what arrived; angles and times as in the messages. What is not finite is left out and does
    not count as an update. Each section has a count that goes up with whatever changes in it.
    """

    def __init__(self, settings: LiveSettings | None = None) -> None:
        self.settings = settings or LiveSettings()
        self.toolface_reading: ToolfaceReading | None = None
        self._selector = ToolfaceSelector()
        periods = {name: float(getattr(self.settings, f"{name}_period")) for name in _STREAMS}
        self._values = LiveValues(_VALUES, periods)
        self._readings: deque[dict[str, Any]] = deque(maxlen=self.settings.readings)
        self._history = StripHistory(_HISTORY, self.settings.history_seconds, self.settings.history_rate)
        self._log = StripHistory(_LOGGED, self.settings.log_length, 1.0 / self.settings.log_step)
        self._log_depth: float | None = None
        self._attitude: dict[str, Any] = {"status": [], "north": "", "stamp_ns": None}
        self._advisory: tuple[float, float] | None = None
        self._in_slips: bool | None = None
        self._links_at = -math.inf
        self._counts: dict[str, int] = {}

    def on_stream(self, stream: str, count: int, now: float, lost: int = 0) -> None:
        """
        Messages of a stream arrived: for rate, age and losses.

        Raises
        ------
        ValueError
            No such stream.
        """
        self._values.arrived(stream, count, now, lost)

    def on_attitude(self, samples: Samples, now: float) -> None:
        """Attitudes arrived, `wire.ATTITUDE`, oldest first; also picks the toolface (`toolface_reading`)."""
        if len(samples) == 0:
            return
        self.on_stream("estimator", len(samples), now)
        last = samples[-1]
        status, north = int(last["status"]), int(last["north"])
        why = next((text for bit, text in _WHY if status & bit), "the estimator gives no sigma")
        for name in ("inclination", "azimuth"):
            self._angle(name, float(last[name]), float(last["sigma_" + name]), why, now)
        inclination = self._values.updated("inclination", now)
        if inclination is not None:
            self._chart("inclination", inclination, now)
        every = int(np.bitwise_or.reduce(samples["status"]))
        self._chart("doubt", 2.0 if every & _BAD else 1.0 if every & _DOUBTFUL else 0.0, now)
        text = [word for word in words(status).split("|") if word]
        self._attitude = {
            "status": text,
            "north": NORTH_WORDS[north] if north < len(NORTH_WORDS) else "",
            "stamp_ns": int(last["stamp_ns"]),
        }
        self._touch("attitude")
        speed = self._values.last("rotary_speed")
        reading = self._selector.update(samples, 0.0 if speed is None else speed)
        if reading is not None:
            self.on_toolface(reading, now, why)

    def on_toolface(self, reading: ToolfaceReading, now: float, why: str = "not available") -> None:
        """A toolface to steer by, where it does not come from `on_attitude`. `why`: said where it has no sigma."""
        self.toolface_reading = reading
        self._angle("toolface", reading.angle, reading.sigma, why, now)
        self._touch("toolface")
        value = self._values.updated("toolface", now)
        if value is None:
            return
        # Two readings need not be exactly one spacing apart to be the next ones.
        if self._readings and now - self._readings[-1]["at"] < self.settings.reading_spacing * 0.95:
            return
        self._readings.append(
            {
                "angle": number(value),
                "mode": TOOLFACE_WORDS[reading.mode],
                "at": number(now),
                "rotating": reading.rotating,
                "stamp_ns": reading.stamp_ns,
            }
        )

    def on_gravity(self, samples: Samples, now: float) -> None:
        """Gravity arrived, `wire.GRAVITY`: vibration (the largest of the block) and rotary speed of the tool."""
        known = samples[samples["sigma"] >= 0.0]
        if len(known) == 0:
            return
        self._put("vibration", float(np.max(known["non_gravity"])), None, now)
        self._put("rotary_speed", float(known["rotary_speed"][-1]), None, now)
        self._put("gravity_sigma", float(known["sigma"][-1]), None, now)

    def on_dynamics(self, samples: Samples, now: float) -> None:
        """Summaries of drilling dynamics arrived, `wire.DYNAMICS`; the last is shown."""
        if len(samples) == 0:
            return
        self.on_stream("dynamics", len(samples), now)
        last = samples[-1]
        if last["stick_slip_index"] >= 0.0:
            self._put("stick_slip", float(last["stick_slip_index"]), None, now)
        else:
            self._withhold("stick_slip", "not turning")
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
        """Temperatures of the sonde arrived, `wire.TEMPERATURE`; a variance of 0 means unknown."""
        if len(samples) == 0:
            return
        self.on_stream("sonde", len(samples), now)
        self.on_stream("temperature", len(samples), now)
        last = samples[-1]
        variance = float(last["variance"])
        self._put("temperature", float(last["temperature"]), math.sqrt(variance) if variance > 0.0 else None, now)

    def on_magnetic_field(self, samples: Samples, now: float) -> None:
        """Fields arrived, `wire.MAG`: the mean of their totals is shown."""
        if len(samples) == 0:
            return
        self.on_stream("sonde", len(samples), now)
        self.on_stream("magnetometer", len(samples), now)
        totals = np.linalg.norm(samples["magnetic_field"], axis=1)
        self._put("total_field", float(np.mean(totals)), None, now)

    def on_interference(self, samples: Samples, now: float) -> None:
        """Interference estimates arrived, `wire.INTERFERENCE`."""
        if len(samples) == 0:
            return
        self.on_stream("interference", len(samples), now)
        last = samples[-1]
        axial, sigma = float(last["axial"]), float(last["sigma_axial"])
        across = np.asarray(last["cross_axial"], dtype=float)
        sigma_across = np.asarray(last["sigma_cross_axial"], dtype=float)
        self._put_known("axial_interference", axial, sigma, now)
        self._put_known("cross_axial_interference", float(np.hypot(*across)), float(np.min(sigma_across)), now)
        observable = sigma >= 0.0 or bool(np.any(sigma_across >= 0.0))
        if observable or last["total_residual"] != 0.0 or last["dip_residual"] != 0.0:
            self._put("field_deviation", float(last["total_residual"]), None, now)
            self._put("dip_deviation", float(last["dip_residual"]), None, now)

    def on_rig_state(self, samples: Samples, now: float) -> None:
        """Rig data arrived, `wire.RIG_STATE`; only what its `valid` vouches for is taken."""
        if len(samples) == 0:
            return
        self.on_stream("rig", len(samples), now)
        last = samples[-1]
        valid = int(last["valid"])
        for k, field in enumerate(_RIG_FIELDS):
            if valid & (1 << k):
                self._put("rig_rotary_speed" if field == "rotary_speed" else field, float(last[field]), None, now)
        self._in_slips = bool(last["in_slips"]) if valid & _RIG_SLIPS else None

    def on_log_depth(self, depth: float | None) -> None:
        """Depth of the sensor, m, while hole is made: what comes next belongs there. None: nothing is drilled."""
        self._log_depth = depth if depth is not None and math.isfinite(depth) and depth >= 0.0 else None
        if self._log_depth is not None:
            self._log.advance(self._log_depth)

    def on_advisory(self, toolface: float | None, limit: float) -> None:
        """Toolface wanted and what it may be off, rad; None: no advice."""
        good = toolface is not None and math.isfinite(toolface) and math.isfinite(limit)
        self._advisory = (float(toolface) % math.tau, abs(float(limit))) if good and toolface is not None else None
        self._touch("toolface")

    def stream_sections(self, now: float) -> dict[str, tuple[dict[str, Any], list[str]]]:
        """Sections of the page by name: each as a table, with the states in it ("live", "stale", "no data")."""
        return {
            "attitude": self._build_attitude(now),
            "toolface": self._build_toolface(now),
            "drilling": self._cells(_DRILLING, now),
            "rig": self._build_rig(now),
            "links": self._build_links(now),
        }

    def strips(self, now: float) -> dict[str, StripHistory]:
        """The charts by name, up to now."""
        self._history.advance(now)
        return {"history": self._history, "depth_log": self._log}

    def _build_attitude(self, now: float) -> tuple[dict[str, Any], list[str]]:
        cells, states = self._cells(("inclination", "azimuth"), now)
        return {**cells, **self._attitude}, states

    def _build_toolface(self, now: float) -> tuple[dict[str, Any], list[str]]:
        cell, reading = self._values.cell("toolface", now), self.toolface_reading
        advisory = None
        if self._advisory is not None:
            target, limit = self._advisory
            inside = None
            if cell["state"] == LIVE:
                inside = abs(math.remainder(cell["value"] - target, math.tau)) <= limit
            advisory = {"toolface": number(target), "limit": number(limit), "inside": inside}
        table = {
            "angle": cell,
            "mode": TOOLFACE_WORDS[self._selector.mode if reading is None else reading.mode],
            "known": reading is not None,
            "rotating": bool(reading and reading.rotating),
            "stamp_ns": None if reading is None else reading.stamp_ns,
            "north": self._attitude["north"],
            "readings": list(self._readings),
            "advisory": advisory,
        }
        return table, [cell["state"]]

    def _build_rig(self, now: float) -> tuple[dict[str, Any], list[str]]:
        cells, states = self._cells(_RIG, now)
        return {**cells, "in_slips": self._in_slips}, states

    def _build_links(self, now: float) -> tuple[dict[str, Any], list[str]]:
        rows = self._values.links(now)
        # The counts run all the time; once a second is enough for people.
        if now - self._links_at >= 1.0 or now < self._links_at:
            self._links_at = now
            self._touch("links")
        return rows, [row["state"] for row in rows.values()]

    def _cells(self, names: Iterable[str], now: float) -> tuple[dict[str, Any], list[str]]:
        cells = {name: self._values.cell(name, now) for name in names}
        return cells, [cell["state"] for cell in cells.values()]

    def _angle(self, name: str, value: float, sigma: float, why: str, now: float) -> None:
        if not (math.isfinite(value) and math.isfinite(sigma) and sigma >= 0.0):
            self._withhold(name, why)
        elif math.degrees(sigma) > self.settings.withheld_sigma_deg:
            self._withhold(name, f"sigma {math.degrees(sigma):.0f} deg" if "sigma" in why else why)
        else:
            self._put(name, value, sigma, now)

    def _put_known(self, name: str, value: float, sigma: float, now: float) -> None:
        if sigma >= 0.0:
            self._put(name, value, sigma, now)
        else:
            self._withhold(name, "not observable yet")

    def _put(self, name: str, value: float, sigma: float | None, now: float) -> None:
        if not math.isfinite(value):
            return
        self._values.put(name, value, sigma, now)
        self._touch(_SECTION_OF[name])
        if name != "inclination":
            self._chart(name, value, now)

    def _chart(self, name: str, value: float, now: float) -> None:
        if name in _HISTORY:
            self._history.add(name, value, now)
        if name in _LOGGED and self._log_depth is not None:
            self._log.add(name, value, self._log_depth)

    def _withhold(self, name: str, why: str) -> None:
        if self._values.withhold(name, why):
            self._touch(_SECTION_OF[name])

    def _touch(self, section: str) -> None:
        self._counts[section] = self._counts.get(section, 0) + 1
