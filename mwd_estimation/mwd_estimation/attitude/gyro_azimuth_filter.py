"""
The filter of the azimuth carried while drilling: one step a bin of time, compiled.

States: azimuth of the hole axis; the slow and the constant error of the magnetic azimuth; the *anchor*: the azimuth
that the last station gave, carried on by the gyros alone; and of either unit the bias of the two cross-axis gyros, the
x rate that leaks into them, the drift that stays in step with gravity, and their lag behind it. The anchor learns
nothing of a magnetic azimuth (a Schmidt-Kalman state: no gain, whole covariance), so that it stands for another opinion
at the next station. The leakage shows in the cross-axis rates of a turning tool themselves (`spun`). Derivation:
``docs/fusion.md``.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.attitude.azimuth_rate import (
    S_EARTH,
    S_GAP,
    S_LAG,
    S_NOISE,
    S_RATE_Y,
    S_SPIN,
    S_TILT,
    S_TIME,
    S_TURN,
    S_XY,
    S_XZ,
    S_Y,
    S_Z,
)
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# States: azimuth, rad; slow and constant magnetic error, each in units of its own sigma; the last station's azimuth
# carried on, rad; and of the conventional, then of the precision unit: bias of y and z, rad/s; x rate that y and z
# feel, rad; rate about the vertical that stays in step with gravity, rad/s; lag of y and z behind gravity, s.
AZIMUTH, ERROR, CONSTANT, ANCHOR, BIAS, LEAK, DRIFT, LAG, STATES = 0, 1, 2, 3, 4, 8, 12, 14, 16
# Memory: a first azimuth exists; seconds since the last magnetic azimuth used, and since the last seen; seconds for
# which good ones have been gated out; last innovation ratio; counts of gated, failed and taken-up-again azimuths; bits
# of the last magnetic azimuth; last bin taken in, and the carried turn at its end; sigma of the last magnetic azimuth;
# whether the azimuth rests on a north seek and the gyros alone; whether a station is carried on, what its azimuth errs
# by that every magnetic azimuth does, rad, and whether the last one that came did not agree with it; mean of the last
# innovation ratios of good magnetic azimuths.
HAVE, SINCE_USED, SINCE_SEEN, REFUSING, RATIO, GATED, FAILED, TAKEN_UP, BITS, LAST_BIN = range(10)
LAST_CARRIED, LAST_SIGMA, SOUGHT, ANCHORED, ANCHOR_LASTING, ANCHOR_OFF, LEAN, MEMORY = 10, 11, 12, 13, 14, 15, 16, 17
# Settings handed to the kernel; the gyros' noise, bias and walk stand twice, conventional then precision.
K_NORTH, K_DOWN, K_OFTEN, K_TAU, K_GATE, K_PATIENCE, K_TIMEOUT, K_VERTICAL, K_GAP_RATE, K_TILT_MEMORY = range(10)
K_NOISE, K_BIAS, K_WALK, K_LEAK, K_DRIFT, K_LAG, K_RANGE, K_WIDEST, SETTINGS = 10, 12, 14, 16, 18, 20, 22, 23, 24
# Fewer turns in a bin do not tell the leakage; the true rate across the axis of which a turn leaves what is left of a
# part of one, rad/s: a curve drilled fast, whirl.
_TURNS, _ACROSS = 0.5, math.radians(0.05)
# An azimuth of a station or a gyro farther than so many sigma from the one carried on disagrees with it.
_DISAGREES = 3.0

# Good magnetic azimuths that lean to one side by so many sigma over this time, s, speak of a gyro whose bias moves (one
# that warms up): its walk is then that of one which may lose all that is known of it in the same time.
_LEANS, _LEAN_TIME = 1.5, 5.0

# A sigma of the magnetic azimuth within this share of the last is the same error.
_SAME = 0.9

_DISTURBED = int(Status.MAG_DISTURBED)


@compiled
def begin(k: Array, x: Array, P: Array, m: Array) -> None:
    """Begin anew; what leaks is known from the turning itself and stays."""
    for i in range(STATES):
        leaks = LEAK <= i < DRIFT and P[i, i] > 0.0
        own = P[i, i] if leaks else 0.0
        for j in range(STATES):
            P[i, j] = P[j, i] = 0.0
        P[i, i] = own
        if not leaks:
            x[i] = 0.0
    for unit in range(2):
        for i in range(2):
            P[BIAS + 2 * unit + i, BIAS + 2 * unit + i] = k[K_BIAS + unit] ** 2
            at = LEAK + 2 * unit + i
            P[at, at] = P[at, at] if P[at, at] > 0.0 else k[K_LEAK + unit] ** 2
        P[DRIFT + unit, DRIFT + unit] = k[K_DRIFT + unit] ** 2
        P[LAG + unit, LAG + unit] = k[K_LAG + unit] ** 2
    P[ERROR, ERROR] = P[CONSTANT, CONSTANT] = 1.0
    m[HAVE] = 1.0
    m[ANCHORED] = m[ANCHOR_OFF] = 0.0


@compiled
def _take_in(x: Array, P: Array, ph: Array, innovation: float, s: float) -> None:
    """Kalman update by one number: ph its covariance with the states, s its variance; the anchor has no gain."""
    # Its own row and column go down with the others' gains, its variance stays (Joseph's form with that gain zero).
    kept = P[ANCHOR, ANCHOR]
    for i in range(STATES):
        if i != ANCHOR:
            x[i] += ph[i] / s * innovation
        for j in range(STATES):
            P[i, j] -= ph[i] * ph[j] / s
    P[ANCHOR, ANCHOR] = kept
    x[AZIMUTH] %= 2.0 * math.pi


@compiled
def correct(
    k: Array, x: Array, P: Array, m: Array, slow: float, lasting: float, azimuth: float, r2: float, more: float
) -> bool:
    """
    Update by an azimuth = x[AZIMUTH] + slow x[ERROR] + lasting x[CONSTANT] + noise of variance r2.

    more: variance to add once the azimuth has passed the gate, for noise that the next ones repeat. False, with nothing
    changed, beyond the gate.
    """
    ph = np.zeros(STATES)
    for i in range(STATES):
        ph[i] = P[i, AZIMUTH] + slow * P[i, ERROR] + lasting * P[i, CONSTANT]
    s = ph[AZIMUTH] + slow * ph[ERROR] + lasting * ph[CONSTANT] + r2
    innovation = azimuth - x[AZIMUTH] - slow * x[ERROR] - lasting * x[CONSTANT]
    innovation = (innovation + math.pi) % (2.0 * math.pi) - math.pi
    m[RATIO] = innovation / math.sqrt(s)
    if abs(m[RATIO]) > k[K_GATE]:
        return False
    _take_in(x, P, ph, innovation, s + more)
    return True


@compiled
def fade(x: Array, P: Array, share: float) -> None:
    """Let all but a share of the slow magnetic error be another one."""
    x[ERROR] *= share
    for j in range(STATES):
        if j != ERROR:
            P[ERROR, j] *= share
            P[j, ERROR] = P[ERROR, j]
    P[ERROR, ERROR] = 1.0 + share * share * (P[ERROR, ERROR] - 1.0)


@compiled
def propagate(k: Array, x: Array, P: Array, sums: Array, unit: int) -> None:
    """
    Carry azimuth and anchor through one bin; unit 0: conventional gyros, 1: precision gyros.

    azimuth += turn - bias . (Y, Z) - leak . (XY, XZ) - lag LAG - drift time - K_DOWN time + K_NORTH cos(azimuth) EARTH:
    of the rate about the vertical the part that moves the axis, (w - w_ie) . (d - (d.x) x) / sin^2(I), summed over the
    bin.
    """
    slopes = np.zeros((2, STATES))
    rows = np.zeros((2, STATES))
    turn = sums[S_TURN] - k[K_DOWN] * sums[S_TIME]
    north = k[K_NORTH] * sums[S_EARTH]
    for n in range(2):
        one = AZIMUTH if n == 0 else ANCHOR
        slopes[n, one] = 1.0 - north * math.sin(x[one])
        slopes[n, BIAS + 2 * unit], slopes[n, BIAS + 2 * unit + 1] = -sums[S_Y], -sums[S_Z]
        slopes[n, LEAK + 2 * unit], slopes[n, LEAK + 2 * unit + 1] = -sums[S_XY], -sums[S_XZ]
        slopes[n, DRIFT + unit], slopes[n, LAG + unit] = -sums[S_TIME], -sums[S_LAG]
        moved = turn + north * math.cos(x[one])
        for i in range(BIAS, STATES):
            moved += slopes[n, i] * x[i]
        x[one] = (x[one] + moved) % (2.0 * math.pi)
        for i in range(STATES):
            if slopes[n, i] != 0.0:
                for j in range(STATES):
                    rows[n, j] += slopes[n, i] * P[i, j]
    # Gyro noise; the cross-axis rate that an error of the gravity direction mistakes for azimuth; silence.
    noise = k[K_NOISE + unit] ** 2 * sums[S_NOISE] + 2.0 * k[K_TILT_MEMORY] * sums[S_TILT]
    noise += (k[K_GAP_RATE] * sums[S_GAP]) ** 2
    for n in range(2):
        one = AZIMUTH if n == 0 else ANCHOR
        for j in range(STATES):
            if j != AZIMUTH and j != ANCHOR:
                P[one, j] = P[j, one] = rows[n, j]
    for n in range(2):
        for o in range(n + 1):
            both = noise
            for i in range(STATES):
                both += rows[n, i] * slopes[o, i]
            one, other = AZIMUTH if n == 0 else ANCHOR, AZIMUTH if o == 0 else ANCHOR
            P[one, other] = P[other, one] = both
    fade(x, P, math.exp(-sums[S_TIME] / k[K_TAU]))
    for u in range(2):
        for i in range(2):
            P[BIAS + 2 * u + i, BIAS + 2 * u + i] += k[K_WALK + u] ** 2 * sums[S_TIME]


@compiled
def spun(k: Array, x: Array, P: Array, sums: Array, unit: int) -> None:
    """
    What leaks of the x rate into y and z, from a bin in which the tool turned; unit as in `propagate`.

    Whatever truly turns the axis turns round in the tool's own axes and leaves of whole turns nothing: what does not is
    bias time + leak SPIN.
    """
    turns = abs(sums[S_SPIN]) / (2.0 * math.pi)
    if turns < _TURNS:
        return
    time = sums[S_TIME]
    r2 = k[K_NOISE + unit] ** 2 * time + (_ACROSS * time / turns) ** 2
    ph = np.zeros(STATES)
    for axis in range(2):
        bias, leak = BIAS + 2 * unit + axis, LEAK + 2 * unit + axis
        for i in range(STATES):
            ph[i] = time * P[i, bias] + sums[S_SPIN] * P[i, leak]
        s = time * ph[bias] + sums[S_SPIN] * ph[leak] + r2
        innovation = sums[S_RATE_Y + axis] - time * x[bias] - sums[S_SPIN] * x[leak]
        if innovation * innovation <= k[K_GATE] ** 2 * s:
            _take_in(x, P, ph, innovation, s)


@compiled
def _lean(k: Array, P: Array, m: Array, time: float) -> None:
    """Follow to which side good magnetic azimuths lean, and let the biases move where they do; time since the last."""
    gate = k[K_GATE]
    m[LEAN] += min(time / _LEAN_TIME, 1.0) * (min(max(m[RATIO], -gate), gate) - m[LEAN])
    if abs(m[LEAN]) > _LEANS:
        for unit in range(2):
            for i in range(BIAS + 2 * unit, BIAS + 2 * unit + 2):
                P[i, i] = min(P[i, i] + k[K_BIAS + unit] ** 2 * time / _LEAN_TIME, k[K_BIAS + unit] ** 2)


@compiled
def magnetic(k: Array, x: Array, P: Array, m: Array, azimuth: float, sigma: Array, good: bool, afresh: bool) -> None:
    """
    Take in one magnetic azimuth.

    sigma, shape (4,), rad, of what stays (the tool's own field), of what stays for a while (the vertical's error), of
    noise, and of what never changes (the declination).
    """
    slow, held, white, lasting = sigma[0], sigma[1], sigma[2], sigma[3]
    fast2, more = held * held + white * white, held * held * (k[K_OFTEN] - 1.0)
    m[BITS] = _DISTURBED
    if afresh:
        m[HAVE] = m[ANCHORED] = m[LEAN] = 0.0
    kept = m[HAVE] != 0.0 and m[LAST_SIGMA] > 0.0 and slow > 0.0
    share = min(slow / m[LAST_SIGMA], m[LAST_SIGMA] / slow) if kept else 0.0
    if good and share < _SAME:
        if kept:
            # Who learns errs less and less: of the error of before this share is left in it, in units of the sigma of
            # now. A sigma that only flickers has learnt nothing.
            fade(x, P, share)
        m[LAST_SIGMA] = slow
    if kept:
        # As it was when the error was found: by noise in it the filter would tell error and azimuth apart.
        slow = m[LAST_SIGMA]
    if not good:
        m[FAILED] += 1.0
        m[REFUSING] = 0.0
    elif m[HAVE] == 0.0:
        begin(k, x, P, m)
        m[LEAN] = 0.0
        x[AZIMUTH] = azimuth % (2.0 * math.pi)
        # azimuth read = azimuth + slow * error + lasting * constant + noise: the first estimate errs by minus these.
        P[AZIMUTH, AZIMUTH] = slow * slow + fast2 + lasting * lasting
        P[AZIMUTH, ERROR] = P[ERROR, AZIMUTH] = -slow
        P[AZIMUTH, CONSTANT] = P[CONSTANT, AZIMUTH] = -lasting
        m[BITS] = 0.0
    elif correct(k, x, P, m, slow, lasting, azimuth, fast2, more):
        m[BITS] = 0.0
    else:
        m[GATED] += 1.0
        # Between two samples at most the time-out counts, so that a drop-out is no evidence.
        m[REFUSING] += min(m[SINCE_SEEN], k[K_TIMEOUT])
        if m[REFUSING] > k[K_PATIENCE]:
            # Steadily elsewhere with its field in order: the carried azimuth is wrong by more than it said.
            m[TAKEN_UP] += 1.0
            innovation = azimuth - x[AZIMUTH] - slow * x[ERROR] - lasting * x[CONSTANT]
            innovation = (innovation + math.pi) % (2.0 * math.pi) - math.pi
            P[AZIMUTH, AZIMUTH] += innovation * innovation
            correct(k, x, P, m, slow, lasting, azimuth, fast2, more)
            m[BITS] = 0.0
    if good:
        _lean(k, P, m, min(m[SINCE_SEEN], k[K_TIMEOUT]))
    m[SINCE_SEEN] = 0.0
    if m[BITS] == 0.0:
        m[SOUGHT] = 0.0
        m[REFUSING] = 0.0
        m[SINCE_USED] = 0.0


@compiled
def seek(k: Array, x: Array, P: Array, m: Array, azimuth: float, sigma: float) -> None:
    """
    Take in an azimuth that owes nothing to the magnetometer; one that disagrees is begun anew from.

    Seeks of one gyro err alike: where the azimuth rests on an earlier one, the better of both stands, not their mean.
    """
    if m[HAVE] == 0.0:
        begin(k, x, P, m)
        P[AZIMUTH, AZIMUTH] = math.pi * math.pi
        x[AZIMUTH] = azimuth
    alone = m[SOUGHT] != 0.0
    m[SOUGHT] = 1.0
    away = (azimuth - x[AZIMUTH] + math.pi) % (2.0 * math.pi) - math.pi
    agrees = away * away <= _DISAGREES**2 * (P[AZIMUTH, AZIMUTH] + sigma * sigma)
    if alone and agrees and sigma * sigma >= P[AZIMUTH, AZIMUTH]:
        return
    if alone or not agrees or not correct(k, x, P, m, 0.0, 0.0, azimuth, sigma * sigma, 0.0):
        m[TAKEN_UP] += 0.0 if agrees else 1.0
        x[AZIMUTH] = azimuth % (2.0 * math.pi)
        for i in range(STATES):
            P[AZIMUTH, i] = P[i, AZIMUTH] = 0.0
        P[AZIMUTH, AZIMUTH] = sigma * sigma


@compiled
def station(x: Array, P: Array, m: Array, azimuth: float, sigma: float, lasting: float, sought: bool) -> None:
    """
    Carry on the azimuth of a station from here.

    sigma: its whole one; lasting: the part of it that every magnetic azimuth errs by, rad; sought: a gyro found north
    there. One that disagrees with what is carried on, and no gyro vouches for it, takes its place only where the next
    one disagrees too.
    """
    if m[HAVE] == 0.0:
        return
    if m[ANCHORED] != 0.0 and not sought:
        apart = (azimuth - x[ANCHOR] + math.pi) % (2.0 * math.pi) - math.pi
        variance = P[ANCHOR, ANCHOR] + sigma * sigma - 2.0 * lasting * m[ANCHOR_LASTING]
        if apart * apart > _DISAGREES**2 * variance and m[ANCHOR_OFF] == 0.0:
            m[ANCHOR_OFF] = 1.0
            return
    m[ANCHOR_OFF] = 0.0
    x[ANCHOR] = azimuth % (2.0 * math.pi)
    for i in range(STATES):
        P[ANCHOR, i] = P[i, ANCHOR] = 0.0
    P[ANCHOR, ANCHOR] = sigma * sigma
    m[ANCHORED], m[ANCHOR_LASTING] = 1.0, lasting
