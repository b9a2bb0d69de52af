"""
The filter of the azimuth carried while drilling: one step a bin of time, compiled.

States: azimuth of the hole axis, bias of the two cross-axis gyros of the conventional and of the precision unit, the
slow and the constant error of the magnetic azimuth, and the *anchor*: the azimuth that the last station gave, carried
on by the gyros alone. The anchor learns nothing of a magnetic azimuth (a Schmidt-Kalman state: no gain, whole
covariance), so that it stands for another opinion at the next station. Derivation: ``docs/fusion.md``.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.axis_turn import S_EARTH, S_GAP, S_NOISE, S_TILT, S_TIME, S_TURN, S_Y, S_Z
from mwd_estimation.status import Status
from mwd_estimation.track import Array
from mwd_sensors.compiled import compiled

# States: azimuth, rad; bias y and z of the conventional and of the precision gyros, rad/s; slow and constant magnetic
# error, each in units of its own sigma; the last station's azimuth carried on, rad.
AZIMUTH, BIAS, PRECISION_BIAS, ERROR, CONSTANT, ANCHOR, STATES = 0, 1, 3, 5, 6, 7, 8
# Memory: a first azimuth exists; seconds since the last magnetic azimuth used, and since the last seen; seconds for
# which good ones have been gated out; last innovation ratio; counts of gated, failed and taken-up-again azimuths; bits
# of the last magnetic azimuth; last bin taken in, and the carried turn at its end; sigma of the last magnetic azimuth;
# whether the azimuth rests on a north seek and the gyros alone; whether a station is carried on, and what its azimuth
# errs by that every magnetic azimuth does, rad.
HAVE, SINCE_USED, SINCE_SEEN, REFUSING, RATIO, GATED, FAILED, TAKEN_UP, BITS, LAST_BIN = range(10)
LAST_CARRIED, LAST_SIGMA, SOUGHT, ANCHORED, ANCHOR_LASTING, MEMORY = 10, 11, 12, 13, 14, 15
# Settings handed to the kernel; the gyros' noise, bias and walk stand twice, conventional then precision.
K_NORTH, K_DOWN, K_SHARE, K_TAU, K_GATE, K_PATIENCE, K_TIMEOUT, K_VERTICAL, K_GAP_RATE, K_TILT_MEMORY = range(10)
K_NOISE, K_BIAS, K_WALK, K_RANGE, K_WIDEST, SETTINGS = 10, 12, 14, 16, 17, 18

_DISTURBED = int(Status.MAG_DISTURBED)


@compiled
def begin(k: Array, x: Array, P: Array, m: Array) -> None:
    for i in range(STATES):
        x[i] = 0.0
        for j in range(STATES):
            P[i, j] = 0.0
    for i in range(2):
        P[BIAS + i, BIAS + i] = k[K_BIAS] ** 2
        P[PRECISION_BIAS + i, PRECISION_BIAS + i] = k[K_BIAS + 1] ** 2
    P[ERROR, ERROR] = P[CONSTANT, CONSTANT] = 1.0
    m[HAVE], m[ANCHORED] = 1.0, 0.0


@compiled
def correct(k: Array, x: Array, P: Array, m: Array, slow: float, lasting: float, azimuth: float, r2: float) -> bool:
    """
    Update by an azimuth = x[AZIMUTH] + slow x[ERROR] + lasting x[CONSTANT] + noise.

    False, with nothing changed, beyond the gate.
    """
    ph = np.zeros(STATES)
    for i in range(STATES):
        ph[i] = P[i, AZIMUTH] + slow * P[i, ERROR] + lasting * P[i, CONSTANT]
    s = ph[AZIMUTH] + slow * ph[ERROR] + lasting * ph[CONSTANT] + r2
    innovation = azimuth - x[AZIMUTH] - slow * x[ERROR] - lasting * x[CONSTANT]
    innovation = (innovation + math.pi) % (2.0 * math.pi) - math.pi
    m[RATIO] = abs(innovation) / math.sqrt(s)
    if m[RATIO] > k[K_GATE]:
        return False
    # The anchor has no gain: its own row and column go down with the others' gains, its variance stays.
    kept = P[ANCHOR, ANCHOR]
    for i in range(STATES):
        if i != ANCHOR:
            x[i] += ph[i] / s * innovation
        for j in range(STATES):
            P[i, j] -= ph[i] * ph[j] / s
    P[ANCHOR, ANCHOR] = kept
    x[AZIMUTH] %= 2.0 * math.pi
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

    azimuth += turn - bias . (Y, Z) - K_DOWN time + K_NORTH cos(azimuth) EARTH: of the rate about the vertical the part
    that moves the axis, (w - w_ie) . (d - (d.x) x) / sin^2(I), summed over the bin; the x rate drops out.
    """
    at = BIAS if unit == 0 else PRECISION_BIAS
    turn = sums[S_TURN] - x[at] * sums[S_Y] - x[at + 1] * sums[S_Z] - k[K_DOWN] * sums[S_TIME]
    rows, slopes = np.zeros((2, STATES)), np.zeros(2)
    for n in range(2):
        one = AZIMUTH if n == 0 else ANCHOR
        north = k[K_NORTH] * sums[S_EARTH]
        slopes[n] = 1.0 - north * math.sin(x[one])
        x[one] = (x[one] + turn + north * math.cos(x[one])) % (2.0 * math.pi)
        for j in range(STATES):
            rows[n, j] = slopes[n] * P[one, j] - sums[S_Y] * P[at, j] - sums[S_Z] * P[at + 1, j]
    for n in range(2):
        one = AZIMUTH if n == 0 else ANCHOR
        for j in range(STATES):
            if j != AZIMUTH and j != ANCHOR:
                P[one, j] = P[j, one] = rows[n, j]
    # Gyro noise; the cross-axis rate that an error of the gravity direction mistakes for azimuth; silence.
    noise = k[K_NOISE + unit] ** 2 * sums[S_NOISE] + 2.0 * k[K_TILT_MEMORY] * sums[S_TILT]
    noise += (k[K_GAP_RATE] * sums[S_GAP]) ** 2
    for n in range(2):
        for o in range(n + 1):
            one, other = AZIMUTH if n == 0 else ANCHOR, AZIMUTH if o == 0 else ANCHOR
            both = slopes[o] * rows[n, other] - rows[n, at] * sums[S_Y] - rows[n, at + 1] * sums[S_Z] + noise
            P[one, other] = P[other, one] = both
    fade(x, P, math.exp(-sums[S_TIME] / k[K_TAU]))
    for i in range(2):
        P[BIAS + i, BIAS + i] += k[K_WALK] ** 2 * sums[S_TIME]
        P[PRECISION_BIAS + i, PRECISION_BIAS + i] += k[K_WALK + 1] ** 2 * sums[S_TIME]


@compiled
def magnetic(
    k: Array, x: Array, P: Array, m: Array, azimuth: float, sigma: float, lasting: float, good: bool, afresh: bool
) -> None:
    """Take in one magnetic azimuth."""
    slow, fast2 = sigma * k[K_SHARE], sigma * sigma * (1.0 - k[K_SHARE] ** 2)
    m[BITS] = _DISTURBED
    if afresh:
        m[HAVE] = m[ANCHORED] = 0.0
    if good and m[HAVE] != 0.0 and m[LAST_SIGMA] > 0.0:
        # Who learns errs less and less: of the error of before this share is left in it, in units of the sigma of now.
        fade(x, P, min(sigma / m[LAST_SIGMA], m[LAST_SIGMA] / sigma))
    if good:
        m[LAST_SIGMA] = sigma
    if not good:
        m[FAILED] += 1.0
        m[REFUSING] = 0.0
    elif m[HAVE] == 0.0:
        begin(k, x, P, m)
        x[AZIMUTH] = azimuth % (2.0 * math.pi)
        # azimuth read = azimuth + slow * error + lasting * constant + noise: the first estimate errs by minus these.
        P[AZIMUTH, AZIMUTH] = sigma * sigma + lasting * lasting
        P[AZIMUTH, ERROR] = P[ERROR, AZIMUTH] = -slow
        P[AZIMUTH, CONSTANT] = P[CONSTANT, AZIMUTH] = -lasting
        m[BITS] = 0.0
    elif correct(k, x, P, m, slow, lasting, azimuth, fast2):
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
            correct(k, x, P, m, slow, lasting, azimuth, fast2)
            m[BITS] = 0.0
    m[SINCE_SEEN] = 0.0
    if m[BITS] == 0.0:
        m[SOUGHT] = 0.0
        m[REFUSING] = 0.0
        m[SINCE_USED] = 0.0


@compiled
def seek(k: Array, x: Array, P: Array, m: Array, azimuth: float, sigma: float) -> None:
    """
    Take in an azimuth that owes nothing to the magnetometer; one beyond the gate is begun anew from.

    Seeks of one gyro err alike: where the azimuth rests on an earlier one, the better of both stands, not their mean.
    """
    if m[HAVE] == 0.0:
        begin(k, x, P, m)
        P[AZIMUTH, AZIMUTH] = math.pi * math.pi
        x[AZIMUTH] = azimuth
    alone = m[SOUGHT] != 0.0
    m[SOUGHT] = 1.0
    away = (azimuth - x[AZIMUTH] + math.pi) % (2.0 * math.pi) - math.pi
    agrees = away * away <= k[K_GATE] ** 2 * (P[AZIMUTH, AZIMUTH] + sigma * sigma)
    if alone and agrees and sigma * sigma >= P[AZIMUTH, AZIMUTH]:
        return
    if alone or not correct(k, x, P, m, 0.0, 0.0, azimuth, sigma * sigma):
        m[TAKEN_UP] += 0.0 if agrees else 1.0
        x[AZIMUTH] = azimuth % (2.0 * math.pi)
        for i in range(STATES):
            P[AZIMUTH, i] = P[i, AZIMUTH] = 0.0
        P[AZIMUTH, AZIMUTH] = sigma * sigma


@compiled
def station(x: Array, P: Array, m: Array, azimuth: float, sigma: float, lasting: float) -> None:
    """
    Carry on the azimuth of a station from here.

    sigma: its whole one; lasting: the part of it that every magnetic azimuth errs by, rad.
    """
    if m[HAVE] == 0.0:
        return
    x[ANCHOR] = azimuth % (2.0 * math.pi)
    for i in range(STATES):
        P[ANCHOR, i] = P[i, ANCHOR] = 0.0
    P[ANCHOR, ANCHOR] = sigma * sigma
    m[ANCHORED], m[ANCHOR_LASTING] = 1.0, lasting
