"""
What seconds of motion show of units, axes and signs: gravity and field stand still as seen from the gyros, or do not.

The sums of `axis_consistency` are judged and what they show is noted for `health_evidence`: units by the lengths of
gravity and field, axes by the ways that explain both, signs and frames by the dip where it is known.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.health import axis_consistency as axes
from mwd_estimation.health import cross_axes
from mwd_estimation.health.fault_debounce import (
    ACCEL,
    AGAINST,
    AXES,
    CROSS,
    D0,
    D1,
    D2,
    DEAD,
    FAULT,
    FOR,
    FRAME,
    LENGTH,
    MAG,
    MISMATCH,
    NOTHING,
    OK,
    SIGN,
    STATE,
    STRONGLY,
    UNIT,
    UP,
    note,
)
from mwd_estimation.health.signal_checks import BROKEN
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY

Whole = NDArray[np.int64]

# Samples below which a window says nothing; time below which a dip counts only of a tool that is this quiet: variance
# of the force in the tool's own axes as a share of its square.
_FEW, _ENOUGH_S, _QUIET = 10, 3.0, 1e-3
# Turn from one sample of the field to the next beyond which they do not tell how it went, rad.
_UNSEEN = 0.6
# Reference gravity, m/s^2, total, T, and dip, rad; nan unknown.
GRAVITY, TOTAL, DIP = range(3)
# Units an accelerometer and a magnetometer may come in, beside SI, in the order their findings are numbered in.
_STANDARD_G, _MILLI_G, _FEET = STANDARD_GRAVITY, 101.97, 3.2808
_FIELD_POWERS = np.array([3.0, 4.0, 6.0, 7.0, 9.0])
# Of what a vector sensor says: can be judged, rejects the axes as they are, confirms them, some way fits, gyros in
# deg/s fit.
_JUDGED, _BAD, _TELLS, _SOME, _DEGREES = range(5)
_FORCE, _FIELD = 0, 1
# Mapping k as the axis each axis comes from and its sign.
_ORDERS = np.array([[*np.argmax(np.abs(m), axis=1), *m.sum(axis=1)] for m in axes.MAPPINGS], dtype=np.int64)
_WAYS, _MISTAKES, _WEIGHTS = axes.TABLE_WAYS, axes.MISTAKES, axes.WEIGHTS
_HEAVIEST = 99
# 1 sigma of the direction of the mean force, rad, up to which the dip is judged.
_DIP_NOISE = 0.12
# Rotation, rad/s, that throws a sensor outwards.
_TURNS = 6.0
# Gravity is not in a mean force that is off by this share of it and that many variances of the noise; turn of a window
# up to which the tool is still, rad. What a sensor off the axis feels of the rotation needs a while to average out.
_OFF, _VARIANCES, _STILL, _SOON_S = 0.35, 6.0, 1.0, 1.5
# And is known to be there where the mean is known to this share of it.
_KNOWN = 0.15


@compiled
def _accel_unit(lengths: Array, force2: float, path: float, gravity: float) -> int:
    """0 SI, 1 g, 2 mg or cm/s^2, 3 ft/s^2; -1 none of them, or not to be seen."""
    # Some way to carry it along is nearly right, whatever else is wrong; off the axis the tool's own turning adds.
    rms, still = math.sqrt(force2), math.sqrt(lengths[49]) / gravity
    as_si, as_g, as_mg = False, False, False
    for k in range(50):
        carried = math.sqrt(lengths[k]) / gravity
        as_si = as_si or abs(carried - 1.0) < 0.15
        as_g = as_g or abs(_STANDARD_G * carried - 1.0) < 0.15
        as_mg = as_mg or abs(carried / _MILLI_G - 1.0) < 0.1
    if rms < 0.7 * gravity and as_g:
        return 1
    if rms > 30.0 * gravity and as_mg:
        return 2
    if path < 0.3 and abs(still / _FEET - 1.0) < 0.06 and force2 < 1.2 * lengths[49]:
        return 3
    return 0 if as_si and rms > 0.8 * gravity else -1


@compiled
def _field_unit(field2: float, total: float) -> int:
    """0 SI, else one more than the place in `_FIELD_POWERS`; -1 none of them."""
    rms = math.sqrt(field2)
    if 5e-6 < rms < 3e-4:
        return 0
    unit = -1
    if rms > 3e-4:
        power = math.log10(rms / (total if math.isfinite(total) else 5e-5))
        for k in range(len(_FIELD_POWERS)):
            away = abs(power - _FIELD_POWERS[k])
            if away < 0.5 and (unit <= 0 or away < 0.4):
                unit = k + 1
    return unit


@compiled
def _noise(sums: Array, lengths: Array, force2: float, count: int, spins: bool) -> float:
    """
    1 sigma of the mean force along one axis, in its unit.

    spins : the sensor is off the axis of a tool that turns fast.
    """
    best = 0
    for k in range(axes.WAYS):
        best = k if lengths[k] > lengths[best] else best
    # Vibration that was integrated by the sensor leaves far less of the mean than white noise; an alias far more. Right
    # axes leave the least, of those as they are and those that carry the force best.
    own = min(axes.force_noise(_WAYS, sums, 0), axes.force_noise(_WAYS, sums, best))
    # What it feels of the rotation is left of a turn that half a second did not complete, and averages out.
    if spins or not math.isfinite(own):
        own = math.sqrt(max(force2 - lengths[best], 0.0) / (3.0 * count))
    return max(1.2 * own, 0.004 * math.sqrt(lengths[best]))


@compiled
def _by_gravity(
    lengths: Array, length: float, sigma: float, spins: bool, okay: NDArray[np.bool_], said: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Which ways carry the force to a mean of length `length`, known to a share of sigma, and what that says."""
    # Wrong axes smear gravity; only what a sensor off the axis feels of the rotation can become longer by them.
    if sigma >= 0.08 or (not spins and math.sqrt(lengths[0]) / length - 1.0 > 0.12 + 6.0 * sigma):
        return
    all_of, top, own = True, 0.0, 0.0
    for k in range(axes.WAYS):
        square = lengths[k] / length**2
        off = math.sqrt(max(square - 3.0 * sigma**2, 0.0)) - 1.0
        okay[k] = abs(off) < 0.06 + 3.0 * sigma
        if okay[k]:
            said[_SOME], top = True, max(top, square)
        all_of = all_of and abs(off) < 0.1 + 3.0 * sigma
        if k == 0:
            own = off
    # What is common to two ways, the part along the axis of rotation, cancels between them with its noise.
    margin = 0.05 + 2.2 * sigma
    for k in range(axes.WAYS):
        okay[k] = okay[k] and lengths[k] / length**2 > top - margin
    behind = top - lengths[0] / length**2
    said[_JUDGED] = True
    said[_BAD] = abs(own) > 0.12 + 6.0 * sigma or (own < -0.02 - 2.5 * sigma and behind > margin)
    said[_TELLS] = not said[_BAD] and abs(own) < 0.1 + 3.0 * sigma and not all_of
    said[_DEGREES] = abs(math.sqrt(lengths[48]) / length - 1.0) < 0.06 + 3.0 * sigma


@compiled
def _by_field(lengths: Array, field2: float, okay: NDArray[np.bool_], said: NDArray[np.bool_]) -> None:
    """Which ways hold the field together, and what that says."""
    best, least, own = 0.0, 2.0, lengths[0] / field2
    for k in range(axes.WAYS):
        best, least = max(best, lengths[k] / field2), min(least, lengths[k] / field2)
    for k in range(axes.WAYS):
        okay[k] = lengths[k] / field2 > best - 0.04
    as_degrees = lengths[48] / field2
    said[_JUDGED] = best > 0.93
    said[_BAD] = said[_JUDGED] and best - own > 0.1 and lengths[49] / field2 < 0.9
    said[_TELLS] = said[_JUDGED] and best - own < 0.04 and least < best - 0.1
    said[_DEGREES] = as_degrees > 0.95
    if own < 0.8 and best < 0.85 and as_degrees < 0.9:
        said[_BAD] = True


@compiled
def _explains(m: int, okay: NDArray[np.bool_], said: NDArray[np.bool_]) -> bool:
    """Whether a mistake explains what gravity and field showed of the motion."""
    by_force = not said[_FORCE, _JUDGED] or okay[_FORCE, _MISTAKES[m, 2]]
    by_field = not said[_FIELD, _JUDGED] or okay[_FIELD, _MISTAKES[m, 3]]
    return bool(by_force and by_field)


@compiled
def _dip(sums: Array, k: int, of_force: bool, scale: float) -> float:
    """Dip, rad, if that sensor's axes were mapped by k; nan where the products say more than 1."""
    total = 0.0
    for row in range(3):
        column = _ORDERS[k, row]
        product = axes.product(sums, row, column) if of_force else axes.product(sums, column, row)
        total += _ORDERS[k, 3 + row] * product
    sine = -total / scale
    return math.asin(min(max(sine, -1.0), 1.0)) if abs(sine) < 1.1 else math.nan


@compiled
def _wrong_axes(
    sums: Array, okay: NDArray[np.bool_], said: NDArray[np.bool_], dip: float, scale: float, masks: Whole
) -> bool:
    """
    The least contrived mistakes that explain the motion, as bits by sensor, and the dip if it is known (not nan).

    Without any that explains the dip too, those that explain the motion alone; False for none.
    """
    for use_dip in range(2):
        lightest = _HEAVIEST
        for m in range(len(_MISTAKES)):
            sensor, k = _MISTAKES[m, 0], _MISTAKES[m, 1]
            if _WEIGHTS[m] > lightest or not _explains(m, okay, said):
                continue
            if use_dip == 0 and math.isfinite(dip):
                found = _dip(sums, k if sensor > 0 else 0, sensor == 1, scale)
                if not abs(found - dip) < 0.21:
                    continue
            if _WEIGHTS[m] < lightest:
                masks[0] = masks[1] = masks[2] = 0
                lightest = _WEIGHTS[m]
            masks[sensor] |= 1 << k
        if lightest < _HEAVIEST:
            return True
    return False


@compiled
def _wrong_frame(
    sums: Array, okay: NDArray[np.bool_], said: NDArray[np.bool_], dip: float, scale: float, length: float, up: float,
    masks: Whole,
) -> None:  # fmt: skip
    """The least contrived mistakes that leave the hole pointing down and explain motion and dip, as bits by sensor."""
    masks[0] = masks[1] = masks[2] = 0
    lightest = _HEAVIEST
    for m in range(len(_MISTAKES)):
        sensor, k = _MISTAKES[m, 0], _MISTAKES[m, 1]
        if sensor == 0 or _WEIGHTS[m] > 3 or _WEIGHTS[m] > lightest:
            continue
        rise = up
        if sensor == 1:
            rise = 0.0
            for row in range(3):
                if _ORDERS[k, row] == 0:
                    rise = _ORDERS[k, 3 + row] * axes.mean_force(sums, row) / length
        if not (_explains(m, okay, said) and rise < 0.34):
            continue
        if abs(_dip(sums, k, sensor == 1, scale) - dip) < 0.1:
            if _WEIGHTS[m] < lightest:
                masks[0] = masks[1] = masks[2] = 0
                lightest = _WEIGHTS[m]
            masks[sensor] |= 1 << k


@compiled
def _signs(
    reference: Array, sums: Array, began: int, seconds: float, field2: float, length: float, sigma: float, known: bool,
    okay: NDArray[np.bool_], said: NDArray[np.bool_], checks: Whole, notes: Whole,
) -> None:  # fmt: skip
    """Signs and frames: by the dip where the reference is known, else by which way a turning string points."""
    if sigma > _DIP_NOISE:
        return
    up = axes.mean_force(sums, 0) / length
    inclination = math.acos(min(max(-up, -1.0), 1.0))
    expected = reference[DIP]
    if not known or not abs(expected) > 0.35:
        if abs(axes.turned(sums, 0)) / seconds > 3.0:
            if inclination > 2.1:
                note(notes, SIGN, FOR, began, ACCEL, 1, 0)
            elif inclination < 1.75:
                note(notes, SIGN, AGAINST, began, 0, 0, 0)
        return
    scale = length * math.sqrt(field2)
    dip = _dip(sums, 0, True, scale)
    off = abs(dip - expected)
    flipped = abs(dip + expected) < 0.21 and off > 0.52 + 5.0 * sigma
    who = ACCEL if inclination > 1.75 else (MAG if inclination < 1.4 else ACCEL | MAG)
    note(notes, SIGN, FOR if flipped else (AGAINST if off < 0.26 else NOTHING), began, who, 0, 0)
    close = abs(math.sqrt(field2) / reference[TOTAL] - 1.0) < 0.05
    seen = FOR if off > 0.26 + 5.0 * sigma and not flipped and close else (AGAINST if off < 0.2 else NOTHING)
    masks = np.zeros(3, dtype=np.int64)
    if seen == FOR:
        _wrong_frame(sums, okay, said, expected, scale, length, up, masks)
    row = checks[FRAME]
    if row[UP] > 0 and (row[D1] | row[D2]) != 0:
        # What several windows leave possible together; where nothing is left, what was possible before.
        both_f, both_b = masks[1] & row[D1], masks[2] & row[D2]
        keeps = (both_f | both_b) == 0
        masks[1] = row[D1] if keeps else both_f
        masks[2] = row[D2] if keeps else both_b
    note(notes, FRAME, seen, began, 0, masks[1], masks[2])


@compiled
def _no_gravity(
    sums: Array, lengths: Array, force2: float, field2: float, count: int, gravity: float, pushed: bool, sure: bool,
    said: NDArray[np.bool_],
) -> tuple[int, float]:  # fmt: skip
    """
    Whether the force carried along has a mean that gravity cannot be in, and its length.

    Nothing in a hole is pushed one way for seconds; that holds as seen from gyros that are still, or which the field
    confirms. sure : the axes are known to be right; without, any of them may explain it.
    """
    most, least, steady = 0.0, math.inf, 0.0
    for k in range(axes.WAYS):
        steady = max(steady, lengths[1, k])
        if k == 0 or not sure:
            most, least = max(most, lengths[0, k]), min(least, lengths[0, k])
    mean = math.sqrt(most)
    still = axes.path(sums) < _STILL and not (field2 > 0.0 and steady < 0.9 * field2)
    by_field = said[_FIELD, _JUDGED] and not said[_FIELD, _BAD] and lengths[1, 0] > 0.9 * field2
    if not still and not by_field:
        return NOTHING, mean
    variance = max(force2 - most, 0.0) / (3.0 * count)
    # Less: by the likelihood of no gravity against gravity, or plainly. A push of half a second may be an alias.
    short, over = gravity - mean, math.sqrt(max(least - 3.0 * variance, 0.0)) - gravity
    less = not pushed and gravity * (gravity - 2.0 * mean) > 2.0 * _VARIANCES * variance
    off = max(short, over)
    if less or (off > _OFF * gravity and off * off > 4.0 * _VARIANCES * variance):
        return (FOR if pushed else STRONGLY), mean
    found = off < 0.2 * gravity + 2.0 * math.sqrt(variance) and variance < (_KNOWN * gravity) ** 2
    return (AGAINST if found else NOTHING), mean


@compiled
def _cross_axes(cross: Array, rotates: bool, began: int, checks: Whole, notes: Whole) -> None:
    """The gyro's y and z, by the field along the tool's axis."""
    found = np.zeros(1, dtype=np.int64)
    seen, row = cross_axes.judge(cross, rotates, found), checks[CROSS]
    if seen == FOR and row[UP] > 0 and found[0] & row[D0] != 0:
        found[0] &= row[D0]
    note(notes, CROSS, seen, began, found[0], 0, 0)


@compiled
def judge(
    reference: Array, sums: Array, cross: Array, lengths: Array, spoilt: Whole, checks: Whole, notes: Whole, now: int,
    seconds: float,
) -> None:  # fmt: skip
    """
    Judge what the last seconds of motion, up to `now`, ns, show of units, axes and signs, and note it.

    Parameters
    ----------
    reference : ndarray, shape (3,)
        GRAVITY, TOTAL, DIP.
    sums : ndarray
        Of `axis_consistency`.
    cross : ndarray
        Of `health_cross_axes`.
    lengths : ndarray, shape (2, 50)
        Room.
    spoilt : ndarray of int64, shape (6,)
        Bins of each sensor that were clipped (below BROKEN) or broken, those in which a steady force pushed, those with
        samples missing, and those in which the force was noise.
    checks, notes : ndarray of int64
        Of `health_evidence`.
    """
    began = now - int(seconds * 1e9 + 0.5)
    count_f = axes.lengths(_WAYS, sums, False, lengths[0])
    count_b = axes.lengths(_WAYS, sums, True, lengths[1])
    force2, field2 = axes.mean_square(sums, False), axes.mean_square(sums, True)
    path, gravity = axes.path(sums), reference[GRAVITY]
    accel_unit = -1
    if count_f >= _FEW and spoilt[1] < BROKEN:
        accel_unit = _accel_unit(lengths[0], force2, path, gravity)
        note(notes, UNIT + 1, FOR if accel_unit > 0 else accel_unit, began, max(accel_unit, 0), 0, 0)
    if count_b >= 3 and spoilt[2] < BROKEN:
        field_unit = _field_unit(field2, reference[TOTAL])
        note(notes, UNIT + 2, FOR if field_unit > 0 else field_unit, began, max(field_unit, 0), 0, 0)
    # Which ways explain gravity and field.
    okay, said = np.zeros((2, axes.WAYS), dtype=np.bool_), np.zeros((2, 5), dtype=np.bool_)
    length = gravity
    if accel_unit == 1:
        length = gravity / _STANDARD_G
    elif accel_unit == 2:
        length = gravity * _MILLI_G
    usable_gyro = spoilt[0] == 0 and checks[DEAD, STATE] != FAULT
    # A push in every half second of it is no alias.
    sigma, spins = 1.0, abs(axes.turned(sums, 0)) > _TURNS * seconds and 2.0 * seconds < spoilt[3] + 0.5
    if spoilt[1] == 0 and count_f >= 4 * _FEW and accel_unit >= 0:
        sigma = _noise(sums, lengths[0], force2, count_f, spins) / length
        if usable_gyro:
            _by_gravity(lengths[0], length, sigma, spins, okay[_FORCE], said[_FORCE])
    if usable_gyro and spoilt[2] == 0 and count_b >= 10 and path < _UNSEEN * count_b and field2 > 0.0:
        _by_field(lengths[1], field2, okay[_FIELD], said[_FIELD])
    lost = NOTHING
    if seconds >= _SOON_S and spoilt[1] < BROKEN and spoilt[5] > 2.0 * seconds - 0.5:
        lost = STRONGLY
        note(notes, LENGTH, lost, began, int(100.0 * math.sqrt(force2 / 3.0)), int(100.0 * gravity + 0.5), 1)
        said[_FORCE] = False
    elif seconds >= _SOON_S and usable_gyro and spoilt[1] < BROKEN and count_f >= 4 * _FEW and accel_unit <= 0:
        lost, mean = AGAINST, 0.0
        if not said[_FORCE, _SOME]:
            sure = checks[AXES, STATE] == OK
            lost, mean = _no_gravity(sums, lengths, force2, field2, count_f, gravity, spoilt[3] > 0, sure, said)
        note(notes, LENGTH, lost, began, int(100.0 * mean + 0.5), int(100.0 * gravity + 0.5), 0)
        if lost >= FOR:
            said[_FORCE] = False
    tells = said[_FORCE, _TELLS] or said[_FIELD, _TELLS]
    # Gyros in deg/s: no string turns that fast, or it turns 57 times less than they say.
    too_fast = path / seconds > 50.0
    unit = NOTHING
    if spoilt[0] == 0 or too_fast:
        explained = said[_FORCE, _SOME] or said[_FIELD, _JUDGED]
        as_degrees = said[_FORCE, _DEGREES] or said[_FIELD, _DEGREES]
        if (too_fast and path / seconds < 50.0 / axes.DEG) or (path > 1.0 and as_degrees and not explained):
            unit = FOR
        elif tells and path > 0.5:
            unit = AGAINST
        note(notes, UNIT, unit, began, 1, 0, 0)
        if unit == FOR or checks[UNIT, STATE] == FAULT:
            return
    masks = np.zeros(3, dtype=np.int64)
    right_strength = math.isfinite(reference[DIP]) and abs(math.sqrt(field2) / reference[TOTAL] - 1.0) < 0.1
    seen = NOTHING
    if said[_FORCE, _BAD] or (said[_FIELD, _BAD] and said[_FIELD, _JUDGED]):
        dip = reference[DIP] if right_strength and count_b > 0 else math.nan
        if _wrong_axes(sums, okay, said, dip, length * math.sqrt(max(field2, 1e-300)), masks):
            seen = FOR
    elif tells:
        seen = AGAINST
    row = checks[AXES]
    if seen == FOR and row[UP] > 0 and ((masks[0] & row[D0]) | (masks[1] & row[D1]) | (masks[2] & row[D2])) != 0:
        # What two windows leave possible together.
        for s in range(3):
            masks[s] &= row[D0 + s]
    note(notes, AXES, seen, began, masks[0], masks[1], masks[2])
    if seconds >= _ENOUGH_S and seen != FOR and row[STATE] == OK and spoilt[0] + spoilt[2] + spoilt[4] == 0:
        _cross_axes(cross, abs(axes.turned(sums, 0)) > seconds, began, checks, notes)
    # Nothing explains it.
    puzzled = seen == NOTHING and said[_FORCE, _BAD] and said[_FIELD, _BAD]
    puzzled = puzzled and (unit == AGAINST or checks[UNIT, UP] == 0)
    note(notes, MISMATCH, FOR if puzzled else (AGAINST if seen == AGAINST else NOTHING), began, 0, 0, 0)
    usable = spoilt[0] < BROKEN and spoilt[1] == 0 and count_f >= 4 * _FEW and accel_unit >= 0
    # What a string that surges or sticks does to a shorter mean is no other dip.
    usable = usable and (seconds >= _ENOUGH_S or force2 - lengths[0, 49] < _QUIET * force2)
    if usable and lost < FOR and seen != FOR and checks[AXES, STATE] != FAULT:
        known = right_strength and spoilt[2] == 0 and count_b >= 3
        _signs(reference, sums, began, seconds, field2, length, sigma, known, okay, said, checks, notes)
