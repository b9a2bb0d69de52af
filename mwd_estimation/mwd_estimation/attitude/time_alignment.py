"""
Continuous attitude: gravity at every sample, the magnetic azimuth carried between magnetic samples.

A magnetic sample is paired with the gravity of its own time, not of its arrival: it is taken into account a fixed
`mag_lag` after its stamp, with gravity interpolated at that stamp. So the result does not depend on the order in which
two topics happen to be delivered, live and replayed results are the same bits, and a turning tool loses no accuracy.
The azimuth of the hole axis hardly moves in that time; the magnetic toolface does, and is carried on by the x gyro.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.magnetic_geometry import raw_azimuth_sample
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.settings import setting

_RING = 1024  # samples of gravity kept for pairing: 0.2 s at 5 kHz
_NO_MAG, _NEAR_VERTICAL = int(Status.NO_MAG), int(Status.NEAR_VERTICAL)
# Integer state: ring head and length, last magnetic stamp and its presence, last stamp, smoothing begins anew, interval
# in which a magnetic sample was last handed on.
_HEAD, _LENGTH, _MAG_NS, _HAVE_MAG, _LAST_NS, _FRESH, _HANDED, _INTEGERS = range(8)
# What is handed on of a magnetic sample: unit vector down, field, sigma of the tilt, azimuth and its sigma.
_P_DOWN, _P_FIELD, _P_TILT, _P_AZIMUTH, _P_SIGMA, _PAIR = 0, 3, 6, 7, 8, 9
# Real state: turn about x, smoothed azimuth vector, toolface from north less the turn, last total and dip; and what
# follows from these and is asked for at every sample: azimuth, toolface less turn, the field's level and downward part.
_TURN, _COS, _SIN, _MTF_COS, _MTF_SIN, _TOTAL, _DIP, _AZIMUTH, _MTF, _LEVEL, _DOWN, _REAL = range(12)


@dataclasses.dataclass(frozen=True)
class Params:
    """How magnetic samples become a continuous azimuth."""

    mag_lag_s: float = setting(
        0.02, "Delay after which a magnetic sample is paired with gravity", unit="s", low=0.0, high=0.2
    )
    mag_timeout_s: float = setting(
        2.0, "Age of the magnetic field beyond which there is no azimuth", unit="s", low=0.1, high=60.0
    )
    smoothing_s: float = setting(1.0, "Time constant of the continuous azimuth", unit="s", low=0.0, high=60.0)
    vertical_enter_deg: float = setting(
        3.0, "Inclination below which azimuth and high side are undefined", unit="deg", low=0.1, high=20.0
    )
    vertical_leave_deg: float = setting(
        4.0, "Inclination above which they are defined again", unit="deg", low=0.1, high=20.0
    )
    handing_on_s: float = setting(
        0.2,
        "A magnetic sample every so often teaches the tool's own field and corrects the azimuth",
        unit="s",
        low=0.01,
    )
    toolface_latency_s: float = setting(
        0.0,
        "Age of a reading at its stamp: both toolfaces are carried on by the x gyro for so long",
        unit="s",
        low=0.0,
        high=2.0,
    )


@dataclasses.dataclass(frozen=True)
class FieldModel:
    """
    What the magnetic samples are to be read with; it changes at surveys, not at samples.

    Attributes
    ----------
    interference : ndarray, shape (3,)
        Field in tool axes that is not the Earth's, T, taken off before use.
    sigma_axial, sigma_cross : float
        1 sigma of what is left of it along and across the axis, T.
    north_correction : float
        Added to the magnetic azimuth to give the named north, rad.
    sigma_north : float
        Its 1 sigma, rad.
    """

    interference: Array
    sigma_axial: float
    sigma_cross: float
    north_correction: float = 0.0
    sigma_north: float = 0.0

    def packed(self) -> Array:
        """All figures in the order the kernel reads them."""
        return np.array(
            [
                *self.interference,
                self.sigma_axial,
                self.sigma_cross,
                self.north_correction,
                self.sigma_north,
            ]
        )


@dataclasses.dataclass
class State:
    """Everything that changes; a copy resumes."""

    stamps: Stamps
    ring: Array
    counters: Stamps
    values: Array
    vertical: NDArray[np.uint8]

    def copy(self) -> State:
        """Independent copy."""
        return State(*(getattr(self, f.name).copy() for f in dataclasses.fields(self)))


@dataclasses.dataclass(frozen=True)
class Rows:
    """
    Attitude of n samples, all of shape (n,).

    Angles in rad, nan where not available (`azimuth`, `magnetic_toolface`) and then with a sigma of pi; `total` T and
    `dip` rad of the last magnetic sample used, however old, nan before the first; `status` the bits this module adds.
    """

    inclination: Array
    azimuth: Array
    gravity_toolface: Array
    magnetic_toolface: Array
    sigma_azimuth: Array
    sigma_magnetic_toolface: Array
    total: Array
    dip: Array
    status: NDArray[np.uint32]


@dataclasses.dataclass(frozen=True)
class Pairs:
    """
    Magnetic samples handed on, each with gravity at its own stamp; m of them.

    Attributes
    ----------
    place, stamp_ns : ndarray of int64, shape (m,)
        IMU sample of the block with which one was taken, and its own stamp.
    g_t, b_t : ndarray, shape (m, 3)
        Unit vector down, and the field as read, T.
    sigma_tilt : ndarray, shape (m,)
        1 sigma of the direction down, rad.
    azimuth, sigma : ndarray, shape (m,)
        By the field model, from its north, and 1 sigma, rad.
    """

    place: Stamps
    stamp_ns: Stamps
    g_t: Array
    b_t: Array
    sigma_tilt: Array
    azimuth: Array
    sigma: Array

    def where(self, chosen: NDArray[np.bool_]) -> Pairs:
        """Those chosen."""
        return Pairs(*(getattr(self, f.name)[chosen] for f in dataclasses.fields(self)))

    @classmethod
    def joined(cls, pairs: list[Pairs]) -> Pairs:
        """All of them in order; places stay those of their own stretch."""
        whole, one, three = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 3))
        pairs = [Pairs(whole, whole, three, three, one, one, one), *pairs]
        return cls(*(np.concatenate([getattr(p, f.name) for p in pairs]) for f in dataclasses.fields(cls)))


def last_totals(state: State) -> tuple[float, float] | None:
    """Total field, T, and dip, rad, of the last magnetic sample used; None before the first."""
    if state.counters[_HAVE_MAG] == 0:
        return None
    return float(state.values[_TOTAL]), float(state.values[_DIP])


def begin_smoothing(state: State) -> None:
    """Forget what was smoothed, because the field model has changed: the next magnetic sample counts whole."""
    state.counters[_FRESH] = 1


def initial() -> State:
    """State before the first sample."""
    counters = np.zeros(_INTEGERS, dtype=np.int64)
    counters[_HANDED] = -1
    return State(
        np.zeros(_RING, dtype=np.int64),
        np.zeros((_RING, 4)),
        counters,
        np.zeros(_REAL),
        np.zeros(1, dtype=np.uint8),
    )


def run(
    params: Params,
    state: State,
    model: FieldModel,
    stamp_ns: Stamps,
    g_t: Array,
    rate_x: Array,
    sigma_tilt: Array,
    mag_ns: Stamps,
    b_t: Array,
) -> tuple[Rows, Pairs, int]:
    """
    Attitude of a block of samples.

    Parameters
    ----------
    params, state, model :
        State is changed in place.
    stamp_ns, g_t, rate_x, sigma_tilt : ndarray, shapes (n,), (n, 3), (n,), (n,)
        Stamps, unit vector down (nan while unknown), rate about the axis, rad/s, and 1 sigma of the tilt, rad.
    mag_ns, b_t : ndarray, shapes (m,) and (m, 3)
        Magnetic samples that wait, in order of their stamps, T.

    Returns
    -------
    rows : Rows
    pairs : Pairs
        One magnetic sample in each interval of `handing_on_s`.
    used : int
        How many of the waiting magnetic samples were taken; the rest waits for the next block.
    """
    n = len(stamp_ns)
    out = np.empty((8, n))
    status = np.empty(n, dtype=np.uint32)
    limits = np.array(
        [
            params.smoothing_s,
            math.radians(params.vertical_enter_deg),
            math.radians(params.vertical_leave_deg),
            params.toolface_latency_s,
        ]
    )
    times = np.array([round(t * 1e9) for t in (params.mag_lag_s, params.mag_timeout_s, params.handing_on_s)])
    pair_at, pairs = np.empty((len(mag_ns), 2), dtype=np.int64), np.empty((len(mag_ns), _PAIR))
    used, handed = _run(
        state.stamps, state.ring, state.counters, state.values, state.vertical, limits, times, model.packed(), stamp_ns,
        g_t, rate_x, sigma_tilt, mag_ns, b_t, out, status, pair_at, pairs,
    )  # fmt: skip
    inclination, azimuth, gravity_toolface, magnetic_toolface, sigma_azimuth, sigma_mtf, total, dip = out
    pair_at, pairs = pair_at[:handed].copy(), pairs[:handed].copy()
    return (
        Rows(inclination, azimuth, gravity_toolface, magnetic_toolface, sigma_azimuth, sigma_mtf, total, dip, status),
        Pairs(
            place=pair_at[:, 0],
            stamp_ns=pair_at[:, 1],
            g_t=pairs[:, _P_DOWN:_P_FIELD],
            b_t=pairs[:, _P_FIELD:_P_TILT],
            sigma_tilt=pairs[:, _P_TILT],
            azimuth=pairs[:, _P_AZIMUTH],
            sigma=pairs[:, _P_SIGMA],
        ),
        used,
    )


@compiled
def _wrap(angle: float) -> float:
    if 0.0 <= angle < 2.0 * math.pi:
        return angle
    # One turn off is the rule, and added exactly; the remainder costs more.
    angle = angle + 2.0 * math.pi if -2.0 * math.pi < angle < 0.0 else angle % (2.0 * math.pi)
    return 0.0 if angle >= 2.0 * math.pi else angle


@compiled
def _find(stamps: Stamps, counters: Stamps, at: int) -> tuple[int, int, float]:
    """Ring places of the samples before and after a time, and the share of the later one; the ends hold."""
    head, length = counters[_HEAD], counters[_LENGTH]
    later = (head - 1) % _RING
    if at >= stamps[later]:
        return later, later, 0.0
    for k in range(2, length + 1):
        earlier = (head - k) % _RING
        if stamps[earlier] <= at:
            span = stamps[later] - stamps[earlier]
            return earlier, later, (at - stamps[earlier]) / span if span > 0 else 0.0
        later = earlier
    return later, later, 0.0


@compiled
def _take_mag(
    stamps: Stamps, ring: Array, counters: Stamps, values: Array, smoothing: float, model: Array, at: int,
    b_x: float, b_y: float, b_z: float, pair: Array,
) -> bool:  # fmt: skip
    """
    Pair one magnetic sample with gravity at its stamp and move azimuth and magnetic toolface towards it.

    Fills the directions and the azimuth of `pair`; False for a sample that says nothing.
    """
    earlier, later, share = _find(stamps, counters, at)
    turn = (1.0 - share) * ring[earlier, 3] + share * ring[later, 3]
    # Both neighbours are turned to the time of the sample before they are mixed: the string may turn fast.
    c_0, s_0 = math.cos(turn - ring[earlier, 3]), math.sin(turn - ring[earlier, 3])
    c_1, s_1 = math.cos(turn - ring[later, 3]), math.sin(turn - ring[later, 3])
    d_x = (1.0 - share) * ring[earlier, 0] + share * ring[later, 0]
    d_y = (1.0 - share) * (c_0 * ring[earlier, 1] + s_0 * ring[earlier, 2])
    d_y += share * (c_1 * ring[later, 1] + s_1 * ring[later, 2])
    d_z = (1.0 - share) * (c_0 * ring[earlier, 2] - s_0 * ring[earlier, 1])
    d_z += share * (c_1 * ring[later, 2] - s_1 * ring[later, 1])
    size = math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)
    pair[_P_FIELD], pair[_P_FIELD + 1], pair[_P_FIELD + 2] = b_x, b_y, b_z
    b_x, b_y, b_z = b_x - model[0], b_y - model[1], b_z - model[2]
    total = math.sqrt(b_x * b_x + b_y * b_y + b_z * b_z)
    if not (math.isfinite(total) and total > 0.0 and size > 0.0):
        return False
    d_x, d_y, d_z = d_x / size, d_y / size, d_z / size
    azimuth = raw_azimuth_sample(-d_x, -d_y, -d_z, b_x, b_y, b_z) + model[5]
    pair[_P_DOWN], pair[_P_DOWN + 1], pair[_P_DOWN + 2], pair[_P_AZIMUTH] = d_x, d_y, d_z, azimuth
    # The scribe line's own direction in the horizontal plane: against north and east = down x north.
    along = b_x * d_x + b_y * d_y + b_z * d_z
    north_x, north_y, north_z = b_x - along * d_x, b_y - along * d_y, b_z - along * d_z
    mtf = math.atan2(d_x * north_y - d_y * north_x, north_z) + model[5]
    spin = 1.0 if d_x > 0.0 else -1.0
    gap = (at - counters[_MAG_NS]) * 1e-9
    fresh = counters[_HAVE_MAG] == 0 or counters[_FRESH] == 1
    keep = 0.0 if fresh or smoothing <= 0.0 or gap <= 0.0 or gap > 10.0 * smoothing else math.exp(-gap / smoothing)
    values[_COS] = keep * values[_COS] + (1.0 - keep) * math.cos(azimuth)
    values[_SIN] = keep * values[_SIN] + (1.0 - keep) * math.sin(azimuth)
    values[_MTF_COS] = keep * values[_MTF_COS] + (1.0 - keep) * math.cos(mtf - spin * turn)
    values[_MTF_SIN] = keep * values[_MTF_SIN] + (1.0 - keep) * math.sin(mtf - spin * turn)
    values[_TOTAL] = total
    values[_LEVEL] = math.sqrt(max(total * total - along * along, 0.0))
    values[_DOWN] = along
    values[_DIP] = math.atan2(along, values[_LEVEL])
    values[_AZIMUTH] = _wrap(math.atan2(values[_SIN], values[_COS]))
    values[_MTF] = math.atan2(values[_MTF_SIN], values[_MTF_COS])
    counters[_MAG_NS] = at
    counters[_HAVE_MAG] = 1
    counters[_FRESH] = 0
    return True


@compiled
def _sigma_azimuth(
    model: Array, axial: float, level: float, down: float, sine: float, cosine: float, tilt: float
) -> float:
    """1 sigma of a magnetic azimuth: interference along and across, tilt through the downward field, the north."""
    if level <= 0.0 or sine <= 0.0:
        return math.pi
    field = (axial * axial + model[4] * model[4] + (down * tilt) ** 2) / (level * level)
    return min(math.sqrt(field + (tilt * cosine / sine) ** 2 + model[6] * model[6]), math.pi)


@compiled
def _sigma_magnetic_toolface(model: Array, level: float, down: float, tilt: float) -> float:
    """1 sigma of the scribe line against north: as the azimuth, without what the axis itself loses near vertical."""
    level = max(level, 1e-9)
    field = (model[4] * model[4] + (down * tilt) ** 2) / (level * level)
    return min(math.sqrt(field + model[6] * model[6]), math.pi)


@compiled
def _run(
    stamps: Stamps, ring: Array, counters: Stamps, values: Array, vertical: NDArray[np.uint8], limits: Array,
    times: Stamps, model: Array, stamp_ns: Stamps, g_t: Array, rate_x: Array, sigma_tilt: Array, mag_ns: Stamps,
    b_t: Array, out: Array, status: NDArray[np.uint32], pair_at: Stamps, pairs: Array,
) -> tuple[int, int]:  # fmt: skip
    used, handed = 0, 0
    lag, timeout, interval, latency = times[0], times[1], times[2], limits[3]
    pair = np.zeros(_PAIR)
    # Interference along the axis, as it lies across the azimuth of now.
    across_axis = model[3] * math.sin(values[_AZIMUTH] - model[5])
    for i in range(len(stamp_ns)):
        stamp = stamp_ns[i]
        d_x, d_y, d_z = g_t[i, 0], g_t[i, 1], g_t[i, 2]
        known = math.isfinite(d_x + d_y + d_z)
        step = (stamp - counters[_LAST_NS]) * 1e-9
        if known and (counters[_LENGTH] == 0 or step > 0.0):
            if counters[_LENGTH] > 0 and step < 0.5 and math.isfinite(rate_x[i]):
                values[_TURN] += rate_x[i] * step
            head = counters[_HEAD]
            stamps[head] = stamp
            ring[head, 0], ring[head, 1], ring[head, 2], ring[head, 3] = d_x, d_y, d_z, values[_TURN]
            counters[_HEAD] = (head + 1) % _RING
            counters[_LENGTH] = min(counters[_LENGTH] + 1, _RING)
            counters[_LAST_NS] = stamp
        while used < len(mag_ns) and mag_ns[used] <= stamp - lag:
            if counters[_LENGTH] > 0 and (counters[_HAVE_MAG] == 0 or mag_ns[used] > counters[_MAG_NS]):
                taken = _take_mag(stamps, ring, counters, values, limits[0], model, mag_ns[used], b_t[used, 0],
                                  b_t[used, 1], b_t[used, 2], pair)  # fmt: skip
                across_axis = model[3] * math.sin(values[_AZIMUTH] - model[5])
                if taken and mag_ns[used] // interval != counters[_HANDED]:
                    counters[_HANDED] = mag_ns[used] // interval
                    cosine = pair[_P_DOWN]
                    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
                    axial = model[3] * sine * math.sin(pair[_P_AZIMUTH] - model[5])
                    pair[_P_TILT] = sigma_tilt[i] if math.isfinite(sigma_tilt[i]) else math.pi
                    pair[_P_SIGMA] = _sigma_azimuth(
                        model, axial, values[_LEVEL], values[_DOWN], sine, cosine, pair[_P_TILT]
                    )
                    pair_at[handed, 0], pair_at[handed, 1] = i, mag_ns[used]
                    for k in range(_PAIR):
                        pairs[handed, k] = pair[k]
                    handed += 1
            used += 1
        have_mag = counters[_HAVE_MAG] == 1
        out[6, i], out[7, i] = (values[_TOTAL], values[_DIP]) if have_mag else (math.nan, math.nan)
        out[1, i] = out[3, i] = math.nan
        out[4, i] = out[5, i] = math.pi
        if not known:
            out[0, i] = out[2, i] = math.nan
            status[i] = _NO_MAG
            continue
        bits = 0
        across = math.sqrt(d_y * d_y + d_z * d_z)
        inclination = math.atan2(across, d_x)
        from_vertical = min(inclination, math.pi - inclination)
        if vertical[0] == 0 and from_vertical < limits[1]:
            vertical[0] = 1
        elif vertical[0] == 1 and from_vertical > limits[2]:
            vertical[0] = 0
        if vertical[0] == 1:
            bits |= _NEAR_VERTICAL
        out[0, i] = inclination
        turned = rate_x[i] * latency
        if latency > 0.0 and math.isfinite(turned):
            # Where the tool is by now: what was measured, turned on about its axis.
            c, s = math.cos(turned), math.sin(turned)
            d_y, d_z = c * d_y + s * d_z, c * d_z - s * d_y
        else:
            turned = 0.0
        out[2, i] = _wrap(math.atan2(-d_y, -d_z))
        if have_mag and stamp - counters[_MAG_NS] <= timeout:
            out[1, i] = values[_AZIMUTH]
            if vertical[0] == 1:
                spin = 1.0 if d_x > 0.0 else -1.0
                turn = values[_TURN]
                if step < 0.0 and math.isfinite(rate_x[i]):
                    # Of a time that has been passed already.
                    earlier, later, share = _find(stamps, counters, stamp)
                    turn = (1.0 - share) * ring[earlier, 3] + share * ring[later, 3]
                out[3, i] = _wrap(values[_MTF] + spin * (turn + turned))
            else:
                out[3, i] = _wrap(values[_AZIMUTH] + math.atan2(-d_y / across, -d_z / across * d_x))
            level, down, tilt = values[_LEVEL], values[_DOWN], sigma_tilt[i]
            size = math.sqrt(across * across + d_x * d_x)
            sine, cosine = across / size, d_x / size
            out[4, i] = _sigma_azimuth(model, across_axis * sine, level, down, sine, cosine, tilt)
            out[5, i] = _sigma_magnetic_toolface(model, level, down, tilt)
        else:
            bits |= _NO_MAG
        status[i] = bits
    return used, handed
