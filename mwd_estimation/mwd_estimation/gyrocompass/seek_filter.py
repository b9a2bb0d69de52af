"""
The compiled filter behind `north_seek`: 33 error states of a tool that lies in its hole, still or turning.

Attitude is integrated in a level frame whose own heading need not be known; per sample only attitude, velocity and the
integrals of the Jacobian move, per block one Kalman step follows: no velocity gained, hole axis and, at rest, roll
where they were. States, measurements and limits: ``docs/north_seeking.md``.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_estimation.core import samples as track
from mwd_estimation.gyrocompass.static_ekf import carry_covariance, rotate_by
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled

# Order of the error state (truth minus estimate) and, from VEL on, of the linear part of the nominal state.
PHI, VEL, EARTH, BIAS, SCALE, LEAK, GSENS, LAG, FORCE = 0, 3, 5, 7, 10, 11, 13, 17, 18
AXIS, ROLL, WOBBLE, LEAD, STATES = 21, 23, 24, 32, 33
# Sums of one block: duration, integral of the tool-to-level matrix (rows), of its columns times what they answer for.
S_TIME, S_MAT, S_SCALE, S_LEAK, S_GSENS, S_LAG, S_FORCE, S_TURN, S_LEAD = 0, 1, 10, 13, 19, 31, 34, 37, 38
S_BIAS, SUMS = 40, 46
# Memory of the filter between blocks.
PHASE, LEVEL_TIME, H0, K0, SETTLED = 0, 1, 2, 5, 8
LAST_AXIS, DIFF2, SCATTER, SEEN, STILL_RUN = 9, 12, 14, 17, 18
ELAPSED, STILL_TIME, TURN_TIME, TURNED, POSITIONS, REFUSED_BLOCKS, MOVED = 19, 20, 21, 22, 23, 24, 25
SAMPLES, CLIPPED, REJECTED, GAPS, CARRIED, MEMORY = 26, 27, 28, 29, 30, 31
LEVELLING, SETTLING, SEEKING = 0.0, 1.0, 2.0
# Settings handed to the kernel.
K_HORIZONTAL, K_VERTICAL, K_GRAVITY, K_LEVEL, K_BLOCK, K_N, K_NX, K_NA = 0, 1, 2, 3, 4, 5, 6, 7
K_B, K_BX, K_BA, K_WALK, K_SCALE, K_LEAK, K_G, K_LAG0, K_LAG = 8, 9, 10, 11, 12, 13, 14, 15, 16
K_VEL, K_AXIS_WALK, K_FLOOR, K_RANGE, K_STILL, K_G0, K_EXPECTED, K_LOCKED = 17, 18, 19, 20, 21, 22, 26, 28
K_LEAD0, K_LEAD, SETTINGS = 29, 30, 31
_SETTLE_BLOCKS = 10.0
_GATE = 25.0
# A tenth of a turn ends a block too: mean and two harmonics of the wobble need more than five looks per turn.
_BLOCK_TURN = 0.64


@compiled
def sample(k: Array, mat: Array, half: Array, x: Array, s: Array, dt: float, w: Array, f: Array) -> None:
    """
    Carry attitude and velocity through one sample and add what the block's error model needs, in place.

    mat, half: tool-to-level matrix by rows, and room for the one in the middle of the sample. w, f: rate, rad/s, and
    force, m/s^2, as measured.
    """
    wx = (w[0] - x[BIAS]) / (1.0 + x[SCALE])
    wy = w[1] - x[BIAS + 1] - x[LEAK] * wx - (x[GSENS] + x[GSENS + 2]) * f[1] - (x[GSENS + 3] + x[GSENS + 1]) * f[2]
    wz = w[2] - x[BIAS + 2] - x[LEAK + 1] * wx - (x[GSENS + 3] - x[GSENS + 1]) * f[1] - (x[GSENS] - x[GSENS + 2]) * f[2]
    # A late gyro saw the level frame from an earlier roll: turn its answer on by what the tool rolled meanwhile.
    late = wx * x[LAG]
    c_late, s_late = math.cos(late), math.sin(late)
    wy, wz = c_late * wy + s_late * wz, c_late * wz - s_late * wy
    fx, gy, gz = f[0] - x[FORCE], f[1] - x[FORCE + 1], f[2] - x[FORCE + 2]
    # The force was felt when the tool had rolled on beyond what the x gyro has told yet.
    ahead = wx * x[LEAD]
    c, q = math.cos(ahead), math.sin(ahead)
    fy, fz = c * gy - q * gz, c * gz + q * gy
    en, ee, ed = x[EARTH], x[EARTH + 1], k[K_VERTICAL]
    rotate_by(mat, 0, True, -dt * en, -dt * ee, -dt * ed)
    rotate_by(mat, 0, False, 0.5 * dt * wx, 0.5 * dt * wy, 0.5 * dt * wz)
    for i in range(9):
        half[i] = mat[i]
    rotate_by(mat, 0, False, 0.5 * dt * wx, 0.5 * dt * wy, 0.5 * dt * wz)
    # Earth rate in tool axes, across the tool: what a lag turns.
    ey = half[1] * en + half[4] * ee + half[7] * ed
    ez = half[2] * en + half[5] * ee + half[8] * ed
    s[S_TIME] += dt
    for i in range(3):
        a, b, d = half[3 * i], half[3 * i + 1], half[3 * i + 2]
        s[S_MAT + 3 * i] += a * dt
        s[S_MAT + 3 * i + 1] += b * dt
        s[S_MAT + 3 * i + 2] += d * dt
        s[S_SCALE + i] += a * wx * dt
        s[S_LAG + i] += (d * ey - b * ez) * wx * dt
        s[S_FORCE + i] += (a * fx + b * fy + d * fz) * dt
        # What the y and z gyros say wrongly is turned on with what they say rightly.
        b, d = c_late * b - s_late * d, s_late * b + c_late * d
        s[S_BIAS + 2 * i] += b * dt
        s[S_BIAS + 2 * i + 1] += d * dt
        s[S_LEAK + 2 * i] += b * wx * dt
        s[S_LEAK + 2 * i + 1] += d * wx * dt
        s[S_GSENS + 4 * i] += (b * f[1] + d * f[2]) * dt
        s[S_GSENS + 4 * i + 1] += (b * f[2] - d * f[1]) * dt
        s[S_GSENS + 4 * i + 2] += (b * f[1] - d * f[2]) * dt
        s[S_GSENS + 4 * i + 3] += (b * f[2] + d * f[1]) * dt
    s[S_LEAD] += (half[2] * fy - half[1] * fz) * wx * dt
    s[S_LEAD + 1] += (half[5] * fy - half[4] * fz) * wx * dt
    x[VEL] += (half[0] * fx + half[1] * fy + half[2] * fz) * dt
    x[VEL + 1] += (half[3] * fx + half[4] * fy + half[5] * fz) * dt
    s[S_TURN] += wx * dt


@compiled
def transition(k: Array, x: Array, s: Array, phi: Array) -> None:
    """Fill phi, shape (5, STATES): attitude and velocity error after the block from the error state before it."""
    t = s[S_TIME]
    en, ee, ed = x[EARTH] * t, x[EARTH + 1] * t, k[K_VERTICAL] * t
    for i in range(5):
        for j in range(STATES):
            phi[i, j] = 0.0
    phi[0, 0], phi[1, 1], phi[2, 2], phi[3, 3], phi[4, 4] = 1.0, 1.0, 1.0, 1.0, 1.0
    phi[0, 1], phi[0, 2], phi[1, 0], phi[1, 2], phi[2, 0], phi[2, 1] = ed, -ee, -ed, en, ee, -en
    phi[0, EARTH], phi[1, EARTH + 1] = -t, -t
    for i in range(3):
        phi[i, BIAS] = -s[S_MAT + 3 * i]
        phi[i, BIAS + 1], phi[i, BIAS + 2] = -s[S_BIAS + 2 * i], -s[S_BIAS + 2 * i + 1]
        phi[i, SCALE] = -s[S_SCALE + i]
        phi[i, LEAK] = -s[S_LEAK + 2 * i]
        phi[i, LEAK + 1] = -s[S_LEAK + 2 * i + 1]
        for j in range(4):
            phi[i, GSENS + j] = -s[S_GSENS + 4 * i + j]
        phi[i, LAG] = -s[S_LAG + i]
    # Velocity: attitude error (mean of before and after) x force, less the force bias.
    fx, fy, fz = s[S_FORCE], s[S_FORCE + 1], s[S_FORCE + 2]
    for j in range(STATES):
        m0 = 0.5 * (phi[0, j] + (1.0 if j == 0 else 0.0))
        m1 = 0.5 * (phi[1, j] + (1.0 if j == 1 else 0.0))
        m2 = 0.5 * (phi[2, j] + (1.0 if j == 2 else 0.0))
        phi[3, j] += m1 * fz - m2 * fy
        phi[4, j] += m2 * fx - m0 * fz
    phi[3, LEAD] += s[S_LEAD]
    phi[4, LEAD] += s[S_LEAD + 1]
    for j in range(3):
        phi[3, FORCE + j] -= s[S_MAT + j]
        phi[4, FORCE + j] -= s[S_MAT + 3 + j]


@compiled
def _predict(k: Array, s: Array, phi: Array, P: Array, rows: Array) -> None:
    t = s[S_TIME]
    carry_covariance(P, phi, rows)
    # White noise: y and z alike, x its own; only the axis direction matters.
    n2, extra = k[K_N] ** 2 * t, (k[K_NX] ** 2 - k[K_N] ** 2) / t
    for i in range(3):
        P[i, i] += n2
        for j in range(3):
            P[i, j] += extra * s[S_MAT + 3 * i] * s[S_MAT + 3 * j]
        P[BIAS + i, BIAS + i] += k[K_WALK] ** 2 * t
    P[VEL, VEL] += k[K_NA] ** 2 * t
    P[VEL + 1, VEL + 1] += k[K_NA] ** 2 * t
    P[AXIS, AXIS] += k[K_AXIS_WALK] ** 2 * t
    P[AXIS + 1, AXIS + 1] += k[K_AXIS_WALK] ** 2 * t


@compiled
def _scalar(P: Array, dx: Array, h: Array, gain: Array, y: float, r2: float) -> float:
    """One scalar update on the error not yet fed back, dx; returns the innovation y - h dx; r2 < 0: only look."""
    for i in range(STATES):
        gain[i] = 0.0
    for j in range(STATES):
        c = h[j]
        if c != 0.0:
            y -= c * dx[j]
            for i in range(STATES):
                gain[i] += P[i, j] * c
    spread = 0.0
    for j in range(STATES):
        spread += h[j] * gain[j]
    if r2 < 0.0:
        gain[0] = spread
        return y
    total = spread + r2
    for i in range(STATES):
        dx[i] += gain[i] / total * y
        for j in range(i + 1):
            P[i, j] -= gain[i] * gain[j] / total
            P[j, i] = P[i, j]
    return y


@compiled
def _direction(
    m: Array, r_at: int, k: Array, P: Array, dx: Array, h: Array, gain: Array, y: float, share: float
) -> bool:
    """Update by one angle that keeps still, with the scatter seen so far as its noise; False if it was gated out."""
    innovation = _scalar(P, dx, h, gain, y, -1.0)
    spread = gain[0]
    r2 = max(k[K_FLOOR] ** 2, m[SCATTER + r_at])
    ok = innovation * innovation < _GATE * (spread + r2)
    # What the prediction does not explain; never below zero, or a wide start would vouch for a noise that is not there.
    seen = max(min(innovation * innovation, _GATE * (spread + r2)) - spread, 0.0)
    m[SCATTER + r_at] += share * (seen - m[SCATTER + r_at])
    if ok:
        _scalar(P, dx, h, gain, y, r2)
    return bool(ok)


@compiled
def frame(m: Array) -> tuple[float, float, float, float, float]:
    """High side (3) and right side (north, east) of the reference axis in the level frame."""
    hx, hy, hz = m[H0], m[H0 + 1], m[H0 + 2]
    across = math.sqrt(hx * hx + hy * hy)
    if across < 1e-6:
        return -math.copysign(1.0, hz), 0.0, 0.0, 0.0, 1.0
    rx, ry = -hy / across, hx / across
    return ry * hz, -rx * hz, rx * hy - ry * hx, rx, ry


@compiled
def _instrument(i: int) -> bool:
    """Whether a state belongs to the instrument, not to where and how the tool lies."""
    return BIAS <= i < AXIS or i == LEAD


@compiled
def _begin(k: Array, mat: Array, x: Array, P: Array, s: Array, m: Array) -> None:
    """
    Level the frame on the mean force; its heading is that of the tool axis, and the start covariance follows.

    What an earlier seek found of the instrument is kept where it is carried on.
    """
    dx, dy, dz = -s[S_FORCE], -s[S_FORCE + 1], -s[S_FORCE + 2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    ax, ay, az = s[S_MAT], s[S_MAT + 3], s[S_MAT + 6]
    along = ax * dx + ay * dy + az * dz
    nx, ny, nz = ax - along * dx, ay - along * dy, az - along * dz
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length < 1e-3 * s[S_TIME]:
        nx, ny, nz = (0.0, dz, -dy) if abs(dx) < 0.9 else (-dz, 0.0, dx)
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    ex, ey, ez = dy * nz - dz * ny, dz * nx - dx * nz, dx * ny - dy * nx
    for j in range(3):
        p, q, r = mat[j], mat[3 + j], mat[6 + j]
        mat[j] = nx * p + ny * q + nz * r
        mat[3 + j] = ex * p + ey * q + ez * r
        mat[6 + j] = dx * p + dy * q + dz * r
    carried = m[CARRIED] > 0.0
    for i in range(STATES):
        kept = carried and _instrument(i)
        if not kept:
            x[i] = 0.0
        for j in range(STATES):
            if not (kept and _instrument(j)):
                P[i, j] = 0.0
    # The frame's x axis is the hole's heading: a linearisation point only, three Earth rates wide.
    x[EARTH], x[EARTH + 1] = k[K_EXPECTED], k[K_EXPECTED + 1]
    for j in range(8):
        P[WOBBLE + j, WOBBLE + j] = 0.02**2 if j % 4 < 2 else 0.01**2
    for j in range(2):
        P[PHI + j, PHI + j] = 0.03**2
        P[VEL + j, VEL + j] = 0.1**2 + k[K_VEL] ** 2
        # Wide and the same in every direction: on the circle where azimuth is read it favours none.
        P[EARTH + j, EARTH + j] = (3.0 * k[K_HORIZONTAL]) ** 2
        P[AXIS + j, AXIS + j] = 0.05**2
    P[PHI + 2, PHI + 2] = 1e-18
    P[ROLL, ROLL] = 0.05**2
    if carried:
        return
    x[LAG] = k[K_LAG0]
    for j in range(4):
        x[GSENS + j] = k[K_G0 + j]
        P[GSENS + j, GSENS + j] = k[K_LOCKED] ** 2 if j < 2 else k[K_G] ** 2
    for j in range(2):
        P[LEAK + j, LEAK + j] = k[K_LEAK] ** 2
        P[BIAS + 1 + j, BIAS + 1 + j] = k[K_B] ** 2
    P[BIAS, BIAS] = k[K_BX] ** 2
    P[SCALE, SCALE] = k[K_SCALE] ** 2
    P[LAG, LAG] = k[K_LAG] ** 2
    x[LEAD] = k[K_LEAD0]
    P[LEAD, LEAD] = k[K_LEAD] ** 2
    for j in range(3):
        P[FORCE + j, FORCE + j] = k[K_BA] ** 2


@compiled
def _settle(m: Array, ax: float, ay: float, az: float, seen: float) -> None:
    """First look at how much the axis scatters from block to block."""
    if seen > 1.0:
        hx, hy, hz, rx, ry = frame(m)
        px, py, pz = ax - m[LAST_AXIS], ay - m[LAST_AXIS + 1], az - m[LAST_AXIS + 2]
        m[DIFF2] += (px * hx + py * hy + pz * hz) ** 2
        m[DIFF2 + 1] += (px * rx + py * ry) ** 2
    m[LAST_AXIS], m[LAST_AXIS + 1], m[LAST_AXIS + 2] = ax, ay, az


@compiled
def _measure(k: Array, mat: Array, x: Array, P: Array, s: Array, m: Array, dx: Array, h: Array, gain: Array) -> None:
    """No velocity gained, hole axis where it was, and, in a tool that does not turn, roll where it was."""
    t = s[S_TIME]
    for j in range(STATES):
        dx[j] = 0.0
    for i in range(2):
        for j in range(STATES):
            h[j] = 0.0
        h[VEL + i] = 1.0
        _scalar(P, dx, h, gain, -x[VEL + i], k[K_VEL] ** 2)
    ax, ay, az, zx, zy, zz = mat[0], mat[3], mat[6], mat[2], mat[5], mat[8]
    if m[PHASE] == SETTLING:
        m[SETTLED] += 1.0
        if m[SETTLED] == 1.0:
            m[H0], m[H0 + 1], m[H0 + 2] = ax, ay, az
        _settle(m, ax, ay, az, m[SETTLED])
        if m[SETTLED] > _SETTLE_BLOCKS:
            m[PHASE] = SEEKING
            for j in range(2):
                m[SCATTER + j] = 0.5 * m[DIFF2 + j] / _SETTLE_BLOCKS
            m[SCATTER + 2] = max(m[SCATTER], m[SCATTER + 1])
            m[H0], m[H0 + 1], m[H0 + 2] = ax, ay, az
    else:
        hx, hy, hz, rx, ry = frame(m)
        up, side = zx * hx + zy * hy + zz * hz, zx * rx + zy * ry
        share = 1.0 / (10.0 + min(m[SEEN], 20.0))
        m[SEEN] += 1.0
        ok = True
        for i in range(2):
            ux, uy, uz = (hx, hy, hz) if i == 0 else (rx, ry, 0.0)
            for j in range(STATES):
                h[j] = 0.0
            # -(phi x a).u = -phi.(a x u)
            h[0], h[1], h[2] = uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax
            h[AXIS + i] = 1.0
            # Wobble of the axis once and twice per turn of the scribe line.
            h[WOBBLE + 4 * i] = up
            h[WOBBLE + 4 * i + 1] = side
            h[WOBBLE + 4 * i + 2] = up * up - side * side
            h[WOBBLE + 4 * i + 3] = 2.0 * up * side
            y = (ax - m[H0]) * ux + (ay - m[H0 + 1]) * uy + (az - m[H0 + 2]) * uz - x[AXIS + i]
            for j in range(WOBBLE + 4 * i, WOBBLE + 4 * i + 4):
                y -= h[j] * x[j]
            ok = _direction(m, i, k, P, dx, h, gain, y, share) and ok
        if ok:
            m[REFUSED_BLOCKS] = 0.0
        else:
            m[REFUSED_BLOCKS] += 1.0
            if m[REFUSED_BLOCKS] >= 5.0:
                # The axis lies elsewhere now: forget where it lay.
                m[REFUSED_BLOCKS] = 0.0
                m[MOVED] += 1.0
                for j in range(2):
                    P[AXIS + j, AXIS + j] += 0.05**2
        quiet = abs(s[S_TURN]) < k[K_STILL] * t
        if quiet and m[STILL_RUN] >= 2.0:
            if m[STILL_RUN] == 2.0:
                m[K0], m[K0 + 1], m[K0 + 2] = zx, zy, zz
                x[ROLL] = 0.0
                dx[ROLL] = 0.0
                for j in range(STATES):
                    P[ROLL, j] = 0.0
                    P[j, ROLL] = 0.0
                P[ROLL, ROLL] = 0.05**2
                m[POSITIONS] += 1.0
            else:
                ux = m[H0 + 1] * m[K0 + 2] - m[H0 + 2] * m[K0 + 1]
                uy = m[H0 + 2] * m[K0] - m[H0] * m[K0 + 2]
                uz = m[H0] * m[K0 + 1] - m[H0 + 1] * m[K0]
                for j in range(STATES):
                    h[j] = 0.0
                h[0], h[1], h[2] = uy * zz - uz * zy, uz * zx - ux * zz, ux * zy - uy * zx
                h[ROLL] = 1.0
                y = (zx - m[K0]) * ux + (zy - m[K0 + 1]) * uy + (zz - m[K0 + 2]) * uz - x[ROLL]
                if not _direction(m, 2, k, P, dx, h, gain, y, share):
                    m[STILL_RUN] = 0.0
        m[STILL_RUN] = m[STILL_RUN] + 1.0 if quiet else 0.0
        if quiet:
            m[STILL_TIME] += t
        else:
            m[TURN_TIME] += t
        m[TURNED] += s[S_TURN]
        m[ELAPSED] += t
    rotate_by(mat, 0, True, dx[0], dx[1], dx[2])
    for j in range(VEL, STATES):
        x[j] += dx[j]


@compiled
def advance(
    k: Array,
    gap_ns: int,
    clock: Stamps,
    mat: Array,
    x: Array,
    P: Array,
    s: Array,
    m: Array,
    stamps: Stamps,
    gyro: Array,
    accel: Array,
) -> None:
    """
    Take samples in: the loop over `sample`, and a Kalman step where a block ends; everything before gap_ns on is state.

    k: settings in the order of the K_ names; gap_ns: a longer silence, ns, begins anew; s, m: sums and memory.
    """
    half, dx, h, gain = np.zeros(9), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    phi, rows = np.zeros((5, STATES)), np.zeros((5, STATES))
    for i in range(len(stamps)):
        w, f = gyro[i], accel[i]
        last = clock[track.LAST_NS]
        verdict = track.admit(clock, stamps[i], w[0], w[1], w[2], f[0], f[1], f[2], gap_ns)
        m[SAMPLES] += 1.0
        if verdict == track.REJECTED:
            m[REJECTED] += 1.0
            continue
        if verdict == track.FIRST:
            continue
        if abs(w[1]) > k[K_RANGE] or abs(w[2]) > k[K_RANGE]:
            m[CLIPPED] += 1.0
        if verdict == track.AFTER_GAP:
            # What the tool did meanwhile is unknown: begin again.
            gaps = m[GAPS] + 1.0
            for j in range(MEMORY):
                m[j] = 0.0
            m[GAPS] = gaps
            for j in range(SUMS):
                s[j] = 0.0
            for j in range(9):
                mat[j] = 1.0 if j % 4 == 0 else 0.0
            for j in range(STATES):
                x[j] = 0.0
            continue
        dt = (stamps[i] - last) * 1e-9
        sample(k, mat, half, x, s, dt, w, f)
        if m[PHASE] == LEVELLING:
            m[LEVEL_TIME] += dt
            if m[LEVEL_TIME] < k[K_LEVEL] - 1e-9:
                continue
            _begin(k, mat, x, P, s, m)
            m[PHASE] = SETTLING
        elif s[S_TIME] >= k[K_BLOCK] - 1e-9 or abs(s[S_TURN]) > _BLOCK_TURN:
            transition(k, x, s, phi)
            _predict(k, s, phi, P, rows)
            _measure(k, mat, x, P, s, m, dx, h, gain)
        else:
            continue
        for j in range(SUMS):
            s[j] = 0.0
