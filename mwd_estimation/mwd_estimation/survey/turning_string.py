# SPDX-License-Identifier: Apache-2.0
"""
Estimate, from a turning string, the misalignment of accelerometers and magnetometers, and the field of the string.

Gravity and the Earth's field are constant while the tool turns about the axis of the hole; roll phi is the integral of
the axial rate of the gyro. Across the tool, a triad measures y + iz = c + G exp(-i phi). If the axis of rotation is at
(1, Re a, Im a) in the triad, its x axis measures a part of the rotating vector too,

    x = c_x + Re(K exp(-i phi)),    K = -conj(a) G.

Hence a = -conj(K / G) is the direction of the axis in each triad, independent of biases, lever arm and delay of stamps.
The mean field across the tool, minus the component of the axial field along this axis, is c - a c_x. It is fixed in the
tool: biases and a magnetised collar. All values are fitted to the samples of windows of some turns. The fit includes a
drift of the amplitudes with the roll (scale error of the gyro, curved hole) and the delay behind the gyro, so that
changes of speed cause no error. The amplitudes at a half and at one and a half cycles per turn, where there is no
signal, are the noise.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.time_jumps import advances
from mwd_estimation.survey.static_survey import BIN_NS
from mwd_sensors.core.arrays import Array, Stamps

# Smallest and largest number of bins of a window, and the angle by which the string turns in a window, rad.
_BINS, _MOST_BINS, _TURNED = 10, 120, 8.0 * math.pi
# A window begins with a bin that has at least this rotation, rad; and longest time between samples within a window, s.
_BEGINS, _APART_S = 0.5, 0.1
# Smallest number of samples in a half second and in a turn; the fit follows one and a half cycles per turn.
_SAMPLES, _PER_TURN = 5, 4
# Largest condition number of the normal equations. It is 5 if the string turns evenly, and 1000 if it turns for a tenth
# of the time; above the limit, the samples of a slow magnetometer do not cover most of the turn.
_WORST_CONDITION = 1e4
# Errors that are the same in every window, 1 sigma: motion along the hole in step with the turns, m (on a bottom that
# is a millimetre higher on one side, a sound tool seems misaligned by 2 deg at 120 rpm), misalignment of the axes after
# calibration, rad, and fields of the electronics, T.
_IN_STEP, _SKEW, _ELECTRONICS = 5e-4, math.radians(0.05), 50e-9
# Columns of the fit, by index: 0 and 1 constant and its drift; 2 and 3 cosine and sine of the roll, 4 and 5 their
# drifts; 6 to 9 noise; 10 and 11 delay of the magnetometer relative to the gyro. Only a change of the rotary speed
# shows the delay: it is fitted if the condition number of the columns is at most `_MOST_ALIKE`.
_CONSTANT, _COS, _SIN, _NOISE, _LATE, _MOST_ALIKE = 0, 2, 3, slice(6, 10), 10, 100.0
# Number of values from which a window's noise is estimated: four amplitudes of three axes.
_NUMBERS = 12.0


@dataclasses.dataclass(frozen=True)
class Across:
    """A vector (y, z) across the tool, and 1 sigma of each component; inf: unknown."""

    value: Array
    sigma: float


@dataclasses.dataclass(frozen=True)
class Turning:
    """Estimates from the turns so far, in tool axes."""

    #: Direction of the axis of rotation in the accelerometers minus its direction in the magnetometers, rad.
    mount: Across
    field: Across  #: field fixed in the tool, T


@dataclasses.dataclass
class _Triad:
    """
    Sums, over the fitted windows, of the readings of one triad (three accelerometers or three magnetometers).

    Units are those of the sensor, squared for weight, axis and noise.
    """

    windows: int = 0  #: number of windows
    weight: float = 0.0  #: squared amplitude of the rotating vector
    axis: complex = 0j  #: tilt of the axis of rotation, y + i z, times this squared amplitude
    across: complex = 0j  #: constant part of y + i z
    along: float = 0.0  #: constant part of x
    noise: float = 0.0  #: variance of an amplitude
    rate2: float = 0.0  #: squared mean rate, (rad/s)^2

    def add(self, columns: Array, values: Array, rate: float) -> None:
        """Fit a window if possible; columns (n, 12) as in `_columns`, values (n, 3) in tool axes, mean rate, rad/s."""
        if not _tells(columns):
            # Do not fit the delay if it is not observable: the speed is constant, or there are only a few short slips.
            columns = columns[:, :_LATE]
        normal = columns.T @ columns
        if np.linalg.cond(normal[:_LATE, :_LATE]) > _WORST_CONDITION:
            return
        inverse = np.linalg.inv(normal)
        found, spread = inverse @ (columns.T @ values), np.diagonal(inverse)
        # Scale the noise amplitudes to the sigma of the least certain of the other amplitudes.
        noise = found[_NOISE] * np.sqrt(spread[[_CONSTANT, _COS, _SIN]].max() / spread[_NOISE, None])
        x, y, z = found[_CONSTANT]
        turning = found[_COS] + 1j * found[_SIN]
        # Average y and z, which have the same amplitude with a phase difference of a quarter turn.
        G, K = 0.5 * (turning[1] + 1j * turning[2]), turning[0]
        self.windows += 1
        self.weight += abs(G) ** 2
        self.axis -= np.conj(K) * G
        self.across += y + 1j * z
        self.along += x
        self.noise += float(np.mean(noise**2))
        self.rate2 += rate**2

    @property
    def mean_noise(self) -> float:
        """
        Mean variance of an amplitude in one window.

        The noise is estimated from few numbers, so the result is the variance of Student's t with as many degrees of
        freedom.
        """
        numbers = _NUMBERS * self.windows
        return self.noise / self.windows * numbers / (numbers - 2.0)

    def tilt(self, alike: float) -> tuple[complex, float]:
        """
        Return the tilt of the axis of rotation, rad, and its variance, rad^2.

        alike: 1 sigma of the error that is the same in every window, of the part of the x readings that turns with the
        string; in the unit of the sensor.
        """
        if not self.weight > 0.0:
            return 0j, math.inf
        variance = self.mean_noise + alike**2 * self.windows
        return self.axis / self.weight, variance / self.weight + _SKEW**2


class _Waiting:
    """Samples of a stream that wait for the end of their half second; samples out of order are ignored."""

    def __init__(self, channels: int) -> None:
        self._parts: list[tuple[Stamps, Array]] = []
        self._none = np.zeros(0, np.int64), np.zeros((0, channels))
        self._newest_ns = np.iinfo(np.int64).min

    def add(self, stamps: Stamps, values: Array) -> None:
        used = advances(stamps, self._newest_ns)
        if used.any():
            self._parts.append((stamps[used], values[used]))
            self._newest_ns = int(self._parts[-1][0][-1])

    def between(self, start_ns: int, end_ns: int) -> tuple[Stamps, Array]:
        """Remove and return the samples from start_ns to before end_ns, ns; drop earlier samples."""
        if not self._parts:
            return self._none
        stamps, values = self._parts[0]
        if len(self._parts) > 1:
            stamps = np.concatenate([stamps for stamps, _ in self._parts])
            values = np.concatenate([values for _, values in self._parts])
        start, end = np.searchsorted(stamps, [start_ns, end_ns])
        self._parts = [(stamps[end:], values[end:])]
        return stamps[start:end], values[start:end]


class TurningString:
    """Estimator from the windows in which the string turned; the samples of a bin are used when the bin is closed."""

    def __init__(self) -> None:
        self._imu, self._mag = _Waiting(5), _Waiting(3)
        self._force, self._field = _Triad(), _Triad()
        self._begin()

    def _begin(self) -> None:
        self._roll, self._last = 0.0, (0, 0.0)
        self._rows: list[tuple[Array, Array, Array]] = []
        self._fields: list[tuple[Array, Array, Array]] = []

    def take_imu(self, stamps: Stamps, rate_x: Array, force: Array, bad: NDArray[np.bool_]) -> None:
        """
        Add samples of the conventional unit, in tool axes.

        stamps: ns, shape (n,); rate_x: rad/s, shape (n,); force: m/s^2, shape (n, 3); bad, shape (n,): whether a sensor
        clips, is doubtful or is faulty.
        """
        self._imu.add(stamps, np.column_stack([rate_x, force, bad]))

    def take_mag(self, stamps: Stamps, field: Array) -> None:
        """Add magnetic samples: stamps, ns, shape (n,), and field, T, shape (n, 3)."""
        self._mag.add(stamps, field)

    def close(self, index: int) -> None:
        """Use the samples of the half second `index`; call this when all samples of this time have arrived."""
        start, end = index * BIN_NS, (index + 1) * BIN_NS
        stamps, values = self._imu.between(start, end)
        mag_stamps, field = self._mag.between(start, end)
        if len(stamps) < _SAMPLES or not np.isfinite(values).all() or values[:, 4].any():
            self._begin()
            return
        rate, force = values[:, 0], values[:, 1:4]
        if not self._rows:
            self._last = int(stamps[0]), float(rate[0])
        apart = np.diff(stamps, prepend=self._last[0]) * 1e-9
        before = np.concatenate([[self._last[1]], rate[:-1]])
        roll = self._roll + np.cumsum(0.5 * (rate + before) * apart)
        if apart.max() > _APART_S or (not self._rows and abs(roll[-1]) < _BEGINS):
            self._begin()
            return
        self._roll, self._last = float(roll[-1]), (int(stamps[-1]), float(rate[-1]))
        self._rows.append((roll, rate, force))
        if len(field):
            at, known = (mag_stamps - end) * 1e-9, (stamps - end) * 1e-9
            self._fields.append((np.interp(at, known, roll), np.interp(at, known, rate), field))
        if len(self._rows) >= _BINS and abs(self._roll) > _TURNED:
            self._fit()
            self._begin()
        elif len(self._rows) >= _MOST_BINS:
            # The string turned a little and has stopped.
            self._begin()

    @property
    def found(self) -> Turning | None:
        """Estimates from the turns so far; None before there are enough turns."""
        in_step = _IN_STEP * self._force.rate2 / max(self._force.windows, 1)
        a_force, of_force = self._force.tilt(in_step)
        a_field, of_field = self._field.tilt(_ELECTRONICS)
        if not math.isfinite(of_force + of_field):
            return None
        field, along = self._field.across / self._field.windows, self._field.along / self._field.windows
        noise = self._field.mean_noise / self._field.windows + _ELECTRONICS**2
        mount, rest = a_force - a_field, field - a_field * along
        return Turning(
            Across(np.array([mount.real, mount.imag]), math.sqrt(of_force + of_field)),
            Across(np.array([rest.real, rest.imag]), math.sqrt(noise + of_field * along**2)),
        )

    def _fit(self) -> None:
        middle, rate = 0.5 * self._roll, self._roll / (len(self._rows) * BIN_NS * 1e-9)
        least = max(_SAMPLES * _BINS, _PER_TURN * abs(self._roll) / math.tau)
        for triad, rows in ((self._force, self._rows), (self._field, self._fields)):
            # Use a triad only if it has samples in the whole window; the magnetometer may have failed in between.
            if len(rows) == len(self._rows) and sum(len(roll) for roll, _, _ in rows) >= least:
                roll, rates, values = (np.concatenate(parts) for parts in zip(*rows, strict=True))
                triad.add(_columns(roll, middle, rates / rate - 1.0), values, rate)


def _tells(columns: Array) -> bool:
    """Return whether the delay can be fitted in a window in addition to the other values; columns, shape (n, 12)."""
    size = np.linalg.norm(columns, axis=0)
    if not size.min() > 0.0:
        return False
    unit = columns / size
    return bool(np.linalg.cond(unit.T @ unit) < _MOST_ALIKE)


def _columns(roll: Array, middle: float, faster: Array) -> Array:
    """Return the columns of a window's fit, (n, 12); roll, middle: rad; faster: rate over mean rate, minus 1."""
    cos, sin, drift = np.cos(roll), np.sin(roll), (roll - middle) / _TURNED
    half, more = 0.5 * roll, 1.5 * roll
    noise = np.cos(half), np.sin(half), np.cos(more), np.sin(more)
    late = faster * cos, faster * sin
    return np.stack([np.ones_like(roll), drift, cos, sin, drift * cos, drift * sin, *noise, *late], axis=1)
