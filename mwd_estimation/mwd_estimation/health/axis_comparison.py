# SPDX-License-Identifier: Apache-2.0
"""
Compare each axis of the precision unit with the axes of the conventional unit while both measure the same motion.

Over a window of half seconds each axis of the precision unit is compared with each axis of the conventional unit at the
same times. An axis should match the same axis of the conventional unit one to one. If it matches a reversed axis,
another axis or another unit of measurement, the fault can be named.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np

from mwd_estimation.core.axis_mappings import MAPPINGS
from mwd_estimation.health import signal_checks
from mwd_estimation.health.signal_checks import BIN_NS
from mwd_sensors.core.arrays import Array, Indices, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.records import dtype_of

# Number of half seconds that are compared together.
WINDOW = 3
# Smallest number of samples for comparing an axis.
_FEW = 20
# _LEAST: smallest rms at which an axis is compared, rad/s and m/s^2. _SHAKEN: largest rms of forces at which two
# accelerometers must agree, m/s^2, because a shock has another shape in another bandwidth and at another place.
_LEAST = (0.005, 0.3)
_SHAKEN = 15.0
# Largest distance between the two units across the tool, m. In a turning string their forces differ by this distance
# times the squared rate, which is not a sign of wrong axes. The housing of a probe is about 5 cm wide.
_ARM = 0.03
# Smallest rms at which an axis is compared, as a share of the unit's largest rms (gyro, accelerometer): a smaller
# signal may be leakage from another axis.
_LEAK = (0.004, 0.02)
# Limits of the misfit of two axes, which is 0 for equal, 1 for unrelated and 2 for reversed signals. Two axes with a
# smaller misfit than _SAME are the same axis; two axes with a larger misfit than _OTHERWISE are different ones.
_SAME, _OTHERWISE = 0.3, 0.6
# An interval longer than this multiple of the usual one contains lost samples.
_LONG = 1.5
# A signal counts as constant if the square of its mean is more than this share of its mean square.
_CONSTANT = 0.8
# Factors from SI to the other units of measurement: deg/s and g.
_UNITS = np.array([math.degrees(1.0), 1.0 / STANDARD_GRAVITY])
_MAPPINGS = np.array(MAPPINGS)
# Result for an axis: twice the index of the matching axis, plus 1 if reversed, plus 6 if in another unit of
# measurement; or one of the following: too little motion, no axis matches, not clear, the axis is at one end of its
# range.
_SILENT_AXIS, _NO_AXIS, _UNCLEAR, AT_ONE_END = -1, -2, -3, -4


class ProductSums:
    """
    Sums of one axis of the precision unit over half a second.

    The sums include the products with the axes of the conventional unit. The first index of the arrays is the unit in
    which the precision unit may send: SI (0), or deg/s or g (1).
    """

    n: float  #: number of pairs of samples
    at_most: float  #: number of samples at the largest magnitude of the half second
    #: `total`, `square`: sum of the samples and of their squares.
    total: float
    square: float
    turn4: float  #: for a cross-axis force: sum of the fourth powers of the rate about the axis, (rad/s)^4
    product: Annotated[Array, 2, 3]  #: sum of the products with each axis of the conventional unit
    #: `other`, `other2`: sums of the samples of each axis of the conventional unit, and of their squares.
    other: Annotated[Array, 2, 3]
    other2: Annotated[Array, 2, 3]


SUMS = dtype_of(ProductSums)


@compiled
def compare(values: Array, own: Array, channels: Any, sums: Any) -> None:
    """
    Count the samples of half a second, and sum their products with those of the conventional unit at the same times.

    Parameters
    ----------
    values, own : ndarray, shape (n, 6)
        Rates, rad/s, and forces, m/s^2, of the precision unit, and of the conventional unit at the same times; NaN if
        unknown.
    channels, sums : ndarray
        Channels of `signal_checks`, and sums of dtype SUMS, shape (6,); the samples are added to both.
    """
    for row in range(6):
        most, first, one = 0.0, 3 * (row // 3), sums[row]
        for i in range(len(values)):
            if math.isfinite(values[i, row]):
                most = max(most, abs(values[i, row]))
        for i in range(len(values)):
            v, beside = values[i, row], own[i, row]
            turn = max(abs(values[i, 0]), abs(own[i, 0]))
            at_most = abs(v) >= 0.999 * most
            # Do not count a gyro at the end of its range while the conventional gyro reads more: it is not stuck.
            if not (row < 3 and at_most and abs(beside) > 1.02 * abs(v) > 0.5):
                signal_checks.count(channels[row], values, row, i, i + 1, math.inf)
            if row >= 3 and math.isfinite(beside):
                # The third sensor of the channels is the conventional accelerometer, used only to detect motion.
                signal_checks.count(channels[3 + row], own, row, i, i + 1, math.inf)
            if not math.isfinite(beside + v):
                continue
            one.n += 1.0
            one.at_most += 1.0 if at_most else 0.0
            one.total += v
            one.square += v * v
            one.turn4 += turn**4 if row > 3 and math.isfinite(turn) else 0.0
            for unit in range(2):
                # Clip the conventional rate to the largest rate of the precision gyro, which may have a smaller range.
                limit = 1.01 * most / (_UNITS[0] if unit == 1 else 1.0) if row < 3 else math.inf
                for c in range(3):
                    other = min(max(own[i, first + c], -limit), limit)
                    one.product[unit, c] += v * other
                    one.other[unit, c] += other
                    one.other2[unit, c] += other * other


@compiled
def interpolated(stamps: Stamps, beside_ns: Stamps, beside: Array) -> Array:
    """
    Return the samples of the conventional unit interpolated at `stamps`, shape (n, 6); NaN if unknown.

    stamps, beside_ns: stamps of the precision and of the conventional unit, ns, shapes (n,) and (m,); beside: samples
    of the conventional unit, shape (m, 6), NaN if unusable.
    """
    found = np.full((len(stamps), 6), math.nan)
    if len(beside_ns) < 2:
        return found
    # Do not interpolate over lost samples, because vibration may have moved the tool in between.
    steps = np.sort(beside_ns[1:] - beside_ns[:-1])
    longest = min(BIN_NS, _LONG * steps[len(steps) // 3])
    right = np.searchsorted(beside_ns, stamps)
    for i in range(len(stamps)):
        at = min(max(right[i] - 1, 0), len(beside_ns) - 2)
        step = beside_ns[at + 1] - beside_ns[at]
        known = beside_ns[at] <= stamps[i] <= beside_ns[at + 1] and 0 < step < longest
        share = (stamps[i] - beside_ns[at]) / max(step, 1)
        for c in range(6):
            found[i, c] = (1.0 - share) * beside[at, c] + share * beside[at + 1, c]
        if not known:
            found[i] = math.nan
    return found


@compiled
def _best(one: Any, k: int, centred: bool, least: float, s: int) -> int:
    """
    Return the result for axis k of sensor s (0 gyro, 1 accelerometer), coded as at `_SILENT_AXIS`.

    one: record of ProductSums; centred: whether to remove the means first; least: smallest rms that is compared, SI.
    """
    n = max(one.n, 1.0)
    off = one.total / n if centred else 0.0
    own = max(one.square - off * one.total, 0.0)
    itself, smallest, best = 2.0, math.inf, 0
    for unit in range(2):
        scale = _UNITS[s] if unit == 1 else 1.0
        for c in range(3):
            mean = one.other[unit, c] / n if centred else 0.0
            other = scale * scale * max(one.other2[unit, c] - mean * one.other[unit, c], 0.0)
            product = scale * (one.product[unit, c] - off * one.other[unit, c])
            size = math.sqrt(other / n)
            allowed = size >= least
            if unit == 0 and c == k and max(math.sqrt(own / n), size) < least:
                return _SILENT_AXIS
            if s == 0 and unit == 1:
                # Do not compare a constant rate in deg/s: a slow rotation would match the clipped bias of a gyro.
                constant = one.other[1, c] ** 2 > _CONSTANT * n * one.other2[1, c]
                allowed = allowed and not constant and one.at_most < 0.5 * n
            for reversed_ in range(2):
                misfit = 2.0
                if allowed:
                    misfit = own + other - 2.0 * product * (1.0 - 2.0 * reversed_)
                    misfit /= max(own + other, 1e-300)
                if unit == 0 and c == k and reversed_ == 0:
                    itself = misfit
                if misfit < smallest:
                    smallest, best = misfit, 6 * unit + 2 * c + reversed_
    if itself < _SAME:
        return 2 * k
    if s == 1 and one.square + one.other2[0, k] - 2.0 * one.product[0, k] < _ARM * _ARM * one.turn4:
        return _SILENT_AXIS
    if smallest < _SAME:
        return best
    return _NO_AXIS if itself > _OTHERWISE else _UNCLEAR


@compiled
def _read_axes(sums: Any, s: int) -> tuple[int, int, int, bool]:
    """Return the result for each axis of sensor s, and whether one of its axes is wrong (`strange` in `axes_of`)."""
    found, shaken = np.full(3, _SILENT_AXIS), 0.0
    # In a steady rotation, a share of the axial rate leaks into the cross-axis gyros and hides their own small rates. A
    # second comparison therefore removes the means, and with them the leakage.
    for centred in range(2 - s):
        greatest2, own2 = 0.0, 0.0
        for k in range(3):
            one = sums[3 * s + k]
            n = max(one.n, 1.0)
            own2 = max(own2, one.square / n)
            for c in range(3):
                mean = one.other[0, c] / n if centred else 0.0
                greatest2 = max(greatest2, (one.other2[0, c] - mean * one.other[0, c]) / n)
        greatest = math.sqrt(greatest2)
        shaken = max(shaken, greatest, math.sqrt(own2))
        least = max(_LEAST[s], _LEAK[s] * greatest)
        for k in range(3):
            one = sums[3 * s + k]
            if found[k] != _SILENT_AXIS or one.n < _FEW:
                continue
            most = max(one.other2[0, 0], one.other2[0, 1], one.other2[0, 2], 0.0)
            full = one.at_most > 0.9 * one.n and one.square > max(4.0 * most, one.n * least**2)
            found[k] = AT_ONE_END if s == 0 and not centred and full else _best(one, k, centred == 1, least, s)
    plain, strange = True, False
    for k in range(3):
        plain = plain and (found[k] == 2 * k or found[k] in (_SILENT_AXIS, _NO_AXIS, _UNCLEAR))
        strange = strange or found[k] == _NO_AXIS
    return found[0], found[1], found[2], strange and plain and (s == 0 or shaken < _SHAKEN)


@compiled
def mapping_of(found: Indices) -> int:
    """
    Return the index in MAPPINGS of the results `found`, shape (3,); 0 (no change) if no mapping fits.

    An axis without a match is assumed to match its own axis, or a free axis if its own is already matched.
    """
    free, matrix = np.ones(3, dtype=np.bool_), np.zeros((3, 3), dtype=np.int64)
    for k in range(3):
        if found[k] >= 0:
            free[found[k] % 6 // 2] = False
    for k in range(3):
        column, sign = found[k] % 6 // 2, 1 - 2 * (found[k] % 2)
        if found[k] < 0:
            column, sign = k, 1
            for c in range(2, -1, -1):
                column = c if free[c] and not free[k] else column
        free[column] = False
        matrix[k, column] = sign
    for k in range(len(_MAPPINGS)):
        if (_MAPPINGS[k] == matrix).all():
            return k
    return 0


@compiled
def axes_of(sums: Any, s: int) -> tuple[Indices, bool, bool]:
    """
    Return the results for the axes of sensor s over a window, and whether its unit of measurement or an axis is wrong.

    sums, shape (WINDOW, 6): dtype SUMS, newest half second last.

    Returns
    -------
    found : ndarray of int64, shape (3,)
        Result for each axis. If the last half second differs from the whole window, the axes have just changed, and all
        results are _SILENT_AXIS.
    scaled : bool
        Whether the sensor sends another unit of measurement.
    strange : bool
        Whether an axis matches no axis of the conventional unit, although no axis matches a wrong one. False for
        accelerometers in strong shocks.
    """
    whole = np.zeros(6, dtype=SUMS)
    for row in range(6):
        one = whole[row]
        for half in range(WINDOW):
            part = sums[half, row]
            one.n += part.n
            one.at_most += part.at_most
            one.total += part.total
            one.square += part.square
            one.turn4 += part.turn4
            for unit in range(2):
                for c in range(3):
                    one.product[unit, c] += part.product[unit, c]
                    one.other[unit, c] += part.other[unit, c]
                    one.other2[unit, c] += part.other2[unit, c]
    x, y, z, strange = _read_axes(whole, s)
    last_x, last_y, last_z, _ = _read_axes(sums[WINDOW - 1], s)
    scaled = max(x, y, z) >= 6 and max(last_x, last_y, last_z) >= 6
    if x != last_x or y != last_y or z != last_z:
        x = y = z = _SILENT_AXIS
    return np.array([x, y, z]), scaled, strange
