# SPDX-License-Identifier: Apache-2.0
"""
Means of force, field and rate over the turns of a string that rotates: where the axis of rotation lies in each triad.

Gravity and the Earth's field turn round as the tool sees them. What is left of their means over whole turns is their
part along the axis of rotation, as each triad has that axis, and what is fixed in the tool: biases, the string's field
across the axis, and the pull of the circle a sensor goes round off the axis (its lever arm times the rate squared). In
a window of bins with y + iz of a triad, roll phi, rate w and its change w',

    force  s = axis F_x + arm (i w' - w^2) + G exp(-i phi)      field  s = rest + G exp(-i phi)

G and how it drifts with the roll (a gyro's scale) are others in each window and are projected out; axis and arm, which
all windows share, are summed as normal equations. The arm shows where the rate changes, most of all where the string
begins to turn or stops; as long as it does not, it leaves the axis uncertain.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.time_bins import Bin
from mwd_estimation.survey.static_survey import BIN_NS
from mwd_sensors.core.arrays import Array

Complex = NDArray[np.complex128]

_BIN_S = BIN_NS * 1e-9
# Bins of a window; the string must turn so far in it, rad; so many such windows at least tell anything.
_WINDOW, _TURNS, _LEAST = 20, 4.0 * math.pi, 2
# Times within a bin, as shares of it from its middle, at which its mean is taken.
_WITHIN = (np.arange(8) + 0.5) / 8.0 - 0.5
# Lever arm of a sensor in a probe before anything is known of it, 1 sigma, m.
_ARM = 0.02
# Least 1 sigma of a bin, m/s^2 and T: vibration moves the mean of an accelerometer by some mg, roll is not quite known.
_FORCE, _FIELD = 0.02, 100e-9
# What neighbouring bins have in common counts them as so many fewer.
_ALIKE = 2.0


@dataclasses.dataclass(frozen=True)
class Turning:
    """
    Means over the turns so far, tool axes; the lever arm is taken off the force.

    Attributes
    ----------
    force, field, rate : ndarray, shape (3,)
        m/s^2, T, rad/s; the field is nan without a magnetometer.
    sigma_force, sigma_field : float
        1 sigma of each component across the axis, without what lasts in the sensors.
    """

    force: Array
    field: Array
    rate: Array
    sigma_force: float
    sigma_field: float


class TurningMeans:
    """Sums over the windows in which the string turned; bins come in order."""

    def __init__(self) -> None:
        self._window: list[tuple[Bin, Bin | None]] = []
        self._normal, self._right = np.zeros((2, 2), complex), np.zeros(2, complex)
        self._field_weight, self._field_sum = 0.0, 0j
        self._windows, self._along, self._rate = 0, np.zeros(2), np.zeros(3)

    def add(self, imu: Bin, mag: Bin | None) -> None:
        """Take the next half second: channels of the IMU are rate and force x y z, rad/s and m/s^2; the field in T."""
        last = self._window[-1] if self._window else None
        if last is None or imu.index != last[0].index + 1 or (mag is None) != (last[1] is None) or imu.count < 3:
            self._window = []
        if imu.count >= 3:
            self._window.append((imu, mag))
        if len(self._window) < _WINDOW:
            return
        if abs(sum(float(one.mean[0]) for one, _ in self._window)) * _BIN_S > _TURNS:
            self._close()
        self._window = []

    @property
    def found(self) -> Turning | None:
        """What the turns have shown; None before there were enough."""
        if self._windows < _LEAST:
            return None
        force_x, field_x = self._along / self._windows
        inverse = np.linalg.inv(self._normal + np.diag([0.0, _ARM**-2]))
        axis = complex((inverse @ self._right)[0]) * force_x
        known = self._field_weight > 0.0
        field = self._field_sum / self._field_weight if known else complex(math.nan, math.nan)
        return Turning(
            force=np.array([force_x, axis.real, axis.imag]),
            field=np.array([field_x if known else math.nan, field.real, field.imag]),
            rate=self._rate / self._windows,
            sigma_force=math.sqrt(float(inverse[0, 0].real)) * abs(float(force_x)),
            sigma_field=self._field_weight**-0.5 if known else math.inf,
        )

    def _close(self) -> None:
        """Add a whole window to the sums."""
        means = np.array([imu.mean for imu, _ in self._window])
        counts = np.array([imu.count for imu, _ in self._window])
        spread = np.array([imu.scatter[0, 0] for imu, _ in self._window]) / counts
        rate = means[:, 0]
        gone, change = (np.cumsum(rate) - 0.5 * rate) * _BIN_S, np.gradient(rate, _BIN_S)
        apart = _WITHIN * _BIN_S
        roll = rate[:, None] * apart + 0.5 * change[:, None] * (apart**2 - 0.25 * _BIN_S**2)
        turning = np.exp(-1j * (gone[:, None] + roll)).mean(axis=1)
        turning = np.stack([turning, (gone - gone.mean()) * turning], axis=1)
        pull = 1j * change - (rate**2 + spread)
        force_x = float(means[:, 3].mean())
        columns = np.stack([np.full(_WINDOW, force_x, complex), pull], axis=1)
        X, s, noise = _projected(columns, means[:, 4] + 1j * means[:, 5], turning, _FORCE)
        self._normal += X.conj().T @ X / noise
        self._right += X.conj().T @ s / noise
        fields = [mag.mean for _, mag in self._window if mag is not None]
        field_x = 0.0
        if len(fields) == _WINDOW:
            b = np.array(fields)
            field_x = float(b[:, 0].mean())
            X, s, noise = _projected(np.ones((_WINDOW, 1), complex), b[:, 1] + 1j * b[:, 2], turning, _FIELD)
            self._field_weight += float((X.conj().T @ X).real[0, 0]) / noise
            self._field_sum += complex((X.conj().T @ s)[0]) / noise
        self._along += np.array([force_x, field_x])
        self._rate += means[:, :3].mean(axis=0)
        self._windows += 1


def _projected(columns: Complex, values: Complex, turning: Complex, least: float) -> tuple[Complex, Complex, float]:
    """Columns and values of a window without what turns round in them, and the variance of a component of a bin."""
    around = np.linalg.qr(turning)[0]
    X = columns - around @ (around.conj().T @ columns)
    s = values - around @ (around.conj().T @ values)
    residual = s - X @ np.linalg.lstsq(X, s, rcond=1e-6)[0]
    free = 2 * (len(values) - columns.shape[1] - turning.shape[1])
    return X, s, _ALIKE * max(float(np.vdot(residual, residual).real) / free, least**2)
