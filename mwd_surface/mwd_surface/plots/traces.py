# SPDX-License-Identifier: Apache-2.0
"""Panels of a plot of a bag for each message type, with their series, units and titles, as one table."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Array, Samples
from mwd_sensors.core.constants import STANDARD_GRAVITY

WHAT = ("sensors", "rig", "truth", "attitude", "surveys", "spectra", "allan")
NORTHS = {0: "unnamed", 1: "magnetic", 2: "true", 3: "grid"}

_AXES = ("x (down-hole)", "y", "z (scribe)")
_DEG = 180.0 / np.pi
_RPM = 30.0 / np.pi


@dataclasses.dataclass(frozen=True)
class Trace:
    """Definition of one panel over time."""

    what: str  #: word of `WHAT` that selects the panel
    #: `title`, `unit`: title and unit; "{north}" in a title is replaced by the north reference of the samples
    title: str
    unit: str
    labels: tuple[str, ...]  #: labels of the series
    #: function that returns the values of n samples, shape (n, series); NaN if a value is not available
    values: Callable[[Samples], Array]
    circle: float = 0.0  #: if positive, the values are angles with this period
    down: bool = False  #: whether the axis points down, as for depth
    log: bool = False  #: whether the axis is logarithmic
    rotary: bool = False  #: whether to add a second axis in r/min to the axis in deg/s
    key: str = ""  #: name of the angle, by which panels of attitude and truth are paired; empty for other panels


def traces_of(type_name: str) -> tuple[Trace, ...]:
    """Return the panels of a message type; empty for types that are not drawn over time."""
    return _TABLE.get(type_name, ())


def north_of(samples: Samples) -> int:
    """Return the north reference of attitude samples as a key of `NORTHS`; 0 if no azimuth has a known north."""
    named = samples["north"][np.isfinite(samples["azimuth"]) & (samples["north"] > 0)]
    return int(named[0]) if len(named) else 0


def _vector(field: str, scale: float = 1.0) -> Callable[[Samples], Array]:
    covariance = field + "_covariance"

    def values(samples: Samples) -> Array:
        out = samples[field] * scale
        if covariance in (samples.dtype.names or ()):
            # REP-145: a covariance that begins with -1 means that the sensor does not report this quantity.
            out = np.where(samples[covariance][:, :1] == -1.0, np.nan, out)
        return np.asarray(out)

    return values


def _field_and_total(samples: Samples) -> Array:
    field = samples["magnetic_field"] * 1e6
    return np.column_stack([field, np.sqrt((field * field).sum(axis=1))])


def _columns(*fields: str, scale: float = 1.0) -> Callable[[Samples], Array]:
    return lambda samples: np.column_stack([samples[field] * scale for field in fields]).astype(float)


def _degrees(*fields: str) -> Callable[[Samples], Array]:
    return _columns(*fields, scale=_DEG)


def _gauge(*fields: str, scale: float = 1.0) -> Callable[[Samples], Array]:
    def values(samples: Samples) -> Array:
        known = {field: (samples["valid"] & wire.RIG_VALID[field]) > 0 for field in fields}
        columns = [np.where(good, samples[field] * scale, np.nan) for field, good in known.items()]
        return np.column_stack(columns)

    return values


def _toolface(samples: Samples) -> Array:
    """Return the gravity toolface of samples, -180 to 180 deg, shape (n, 1)."""
    return np.asarray((samples["gravity_toolface"] * _DEG + 180.0) % 360.0 - 180.0)[:, None]


def _sigmas(samples: Samples) -> Array:
    sigma = _degrees("sigma_inclination", "sigma_azimuth", "sigma_gravity_toolface")(samples)
    return np.where(sigma > 0.0, sigma, np.nan)


def _angles(what: str, north: str, label: str) -> tuple[Trace, ...]:
    """Return the panels of inclination, azimuth and toolface; north: north of the azimuth, for the title."""
    toolface = "gravity toolface (right of high side positive)"
    return (
        Trace(what, "inclination from vertical", "deg", (label,), _degrees("inclination"), key="inclination"),
        Trace(what, f"azimuth from {north} north", "deg", (label,), _degrees("azimuth"), 360.0, key="azimuth"),
        Trace(what, toolface, "deg", (label,), _toolface, 360.0, key="toolface"),
    )


def _count_rate(samples: Samples) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        rate: Array = samples["counts"] / samples["duration"]
    return rate[:, None]


_IMU = (
    Trace("sensors", "angular rate", "deg/s", _AXES, _vector("angular_velocity", _DEG), rotary=True),
    Trace("sensors", "specific force", "m/s²", _AXES, _vector("linear_acceleration")),
)
_TABLE: dict[str, tuple[Trace, ...]] = {
    wire.IMU.type_name: _IMU,
    wire.MAG.type_name: (Trace("sensors", "magnetic field", "µT", (*_AXES, "total"), _field_and_total),),
    wire.TEMPERATURE.type_name: (Trace("sensors", "temperature", "°C", ("sensor",), _columns("temperature")),),
    wire.COUNTS.type_name: (Trace("sensors", "pulses of the gamma detector", "1/s", ("counted",), _count_rate),),
    wire.TOOL_FLOW.type_name: (
        Trace("sensors", "flow through the tool", "l/min", ("flow",), _columns("flow", scale=6e4)),
    ),
    wire.RIG_STATE.type_name: (
        Trace(
            "rig",
            "depth along the hole",
            "m",
            ("bit", "hole"),
            _gauge("bit_depth", "hole_depth"),
            down=True,
        ),
        Trace("rig", "rotary speed", "r/min", ("top drive",), _gauge("rotary_speed", scale=_RPM)),
        Trace("rig", "standpipe pressure", "bar", ("pressure",), _gauge("pressure", scale=1e-5)),
        Trace(
            "rig",
            "hook load and weight on bit",
            "kN",
            ("hook load", "weight on bit"),
            _gauge("hookload", "weight_on_bit", scale=1e-3),
        ),
    ),
    wire.TRUTH.type_name: (
        *_angles("truth", "true", "truth"),
        Trace("truth", "depth of the sonde along the hole", "m", ("truth",), _columns("measured_depth"), down=True),
        Trace("truth", "angular rate", "deg/s", _AXES, _vector("angular_velocity", _DEG), rotary=True),
        Trace("truth", "specific force", "m/s²", _AXES, _vector("specific_force")),
        Trace("truth", "magnetic interference, tool axes", "nT", _AXES, _vector("interference", 1e9)),
        Trace("truth", "gyro bias", "deg/h", _AXES, _vector("gyro_bias", _DEG * 3600.0)),
        Trace("truth", "accelerometer bias", "mg", _AXES, _vector("accel_bias", 1e3 / STANDARD_GRAVITY)),
    ),
    wire.TOOL_STATUS.type_name: (
        Trace("sensors", "battery voltage", "V", ("battery",), _columns("battery_voltage")),
        Trace("sensors", "battery current", "A", ("battery",), _columns("battery_current")),
    ),
    wire.ATTITUDE.type_name: (
        *_angles("attitude", "{north}", "estimate"),
        Trace("attitude", "stated 1 sigma", "deg", ("inclination", "azimuth", "gravity toolface"), _sigmas, log=True),
    ),
    wire.GRAVITY.type_name: (
        Trace("attitude", "acceleration that is not gravity", "m/s²", ("level",), _columns("non_gravity")),
        Trace("attitude", "rotary speed of the tool", "r/min", ("tool",), _columns("rotary_speed", scale=_RPM)),
    ),
    wire.DYNAMICS.type_name: (
        Trace(
            "attitude",
            "rotary speed over the last seconds",
            "r/min",
            ("lowest", "mean", "highest"),
            _columns("rotary_speed_least", "rotary_speed", "rotary_speed_most", scale=_RPM),
        ),
        Trace(
            "attitude",
            "stick-slip",
            "index, share",
            ("index", "share of time at rest"),
            _columns("stick_slip_index", "stick_share"),
        ),
        Trace("attitude", "vibration", "m/s² rms", ("axial", "lateral"), _columns("axial_rms", "lateral_rms")),
        Trace(
            "attitude",
            "peak of the last seconds",
            "m/s²",
            ("axial", "lateral", "shock"),
            _columns("axial_peak", "lateral_peak", "shock_peak"),
        ),
        Trace("attitude", "shocks in the last seconds", "count", ("shocks",), _columns("shocks")),
    ),
    wire.INTERFERENCE.type_name: (
        Trace(
            "attitude",
            "magnetic interference, estimated",
            "nT",
            ("axial (x)", "y", "z"),
            _columns("axial", "cross_axial", scale=1e9),
        ),
    ),
}
