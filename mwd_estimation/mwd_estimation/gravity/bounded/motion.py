"""
What the bounded filter follows of the motion: how firmly a position holds the tool, and what a clipping gyro misses.

Swing, roughness, shocks and lean set the noises of the mechanics; the innovations, averaged over the filter's own
time, say how far its covariance is to be believed. Derivation: ``docs/gravity_bounded.md``.
"""

from __future__ import annotations

import math

from mwd_estimation.gravity.bounded.mechanisation import (
    BIAS,
    DOWN,
    ERRORS,
    MISSING,
    N_DOWN,
    N_LEVER,
    N_MISSING,
    N_SLOPE,
    S_JUMP,
    S_TIME,
    S_TURN,
    SLOPE,
    TILT,
    VEL,
)  # fmt: skip
from mwd_estimation.gravity.bounded.params import (
    K_ACCEL_NOISE,
    K_ACCEL_RANGE,
    K_ANCHOR,
    K_ANCHOR_SWING,
    K_ASKEW,
    K_CLIP_BRIDGE,
    K_CLIP_CURVE,
    K_CLIP_SLOPE,
    K_CLIP_TURN,
    K_FLOOR,
    K_GRAVITY,
    K_GRAVITY_SIGMA,
    K_LEAN_FROM,
    K_LEAN_GAIN,
    K_LEAN_TIME,
    K_LOST,
    K_PLAY,
    K_PLAY_SWING,
    K_RATE_NOISE,
    K_RESERVE,
    K_ROTARY_NOISE,
    K_SHOCK_AT,
    K_SHOCK_GATE,
    K_SHOCK_NOISE,
    K_SWING_MEMORY,
    K_SWING_TIME,
    K_TRAVEL,
)  # fmt: skip
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

# Followed statistics and flags of the filter, and where each begins.
(
    AGE, STARTED, MEAN, MEAN_POWER, LAST_W, LAST_A, DRIFT, SLOW_A, SWING_V, SWING_P, SLOW_ARM, SLOW_ARM_2, SLOW_ARM_3,
    SWING_X, SWING_C, SWING_Z, SETTLED, ROUGH, STRONG, SHOCKS, SINCE_SHOCK, TURNING, PERIOD, NON_GRAVITY, DIRECTION,
    CLIPPING, CLIP_TIME, RATE_SLOPE, RATE_CURVE, LEAN, BOOST, USUAL, NEAR_LEAN, SCALE_ALONG, SCALE_ACROSS, ALIAS, EPOCH,
    CLIP_TILT, KEPT_DOWN, KEPT_TILT, SIGMA_INCLINATION, SIGMA_TOOLFACE, SLOW_AXIS, LEAN_DOWN, SCALE_DOWN,
    LEARNS, BLOCK, BLOCK_TIME, LAST_BLOCK, SLOW_ROUGH, UNSETTLED, SLOW_LEAN, STEADY_ALONG, STEADY_ACROSS,
    WALK_ALONG, WALK_ACROSS, STATISTICS,
) = (
    0, 1, 2, 5, 6, 9, 12, 15, 18, 21, 24, 27, 30,
    33, 34, 35, 36, 37, 38, 39, 40, 41, 42, 43, 44,
    47, 48, 49, 50, 51, 53, 54, 55, 57, 58, 59, 60,
    61, 62, 63, 64, 65, 66, 68, 69,
    70, 71, 74, 75, 78, 79, 80, 82, 83, 84, 85, 86,
)  # fmt: skip
STEADY_TIME, STEADY_AGE = 40.0, 20.0  # s, memory of innovations of one sign; time since a start that half trusts it
TWICE = 0.75  # of the power of a sum that is twice the error: the part that is not error
ALIAS_LEAN = 4.0  # added to the lean from which a bias moves where forces are white: they lean by chance
SLOPE_LAG, CURVE_LAG = 0.03, 0.1  # s, low-passes of the slope of the x rate and of its curvature
TURNING_FROM = 3.0  # rad/s, mean rate about the axis that makes a tool one on a string that turns
HIDDEN = 0.0014  # s of clipping that a sample must be able to show before it counts as a shock
SHOCK_MEMORY, SHOCKS_FROM = 10.0, 6.0  # s; shocks in that time that make shocks frequent
JUMP_FROM = 0.05  # innovation power below which nothing is taken for a velocity lost, however quiet it is usually
NEVER = 1e30  # gate that nothing passes
NEAR_LEAST, NEAR_MOST = 0.3, 12.0  # s, limits of the filter's own time, over which its innovations are summed
NEAR_AGE = 0.15  # the most of it per time since the start, which had more to find out than what is steady
SCALE_TIME = 8.0  # s, memory of the power of that sum, and twice the filter's own time more
HEAVE = 0.015  # m^2, swing along the hole of a string that heaves
DOWN_TIME, DOWN_FROM = 3.0, 0.3  # s; power of the vertical innovations that noises with reserve leave room for
SCALE_YOUNG, SCALE_AGE = 2.0, 0.25  # s and share: after a start it is no longer than these allow
BIAS_SHARE = 0.2  # of the variance of a cross-axis bias that cannot be learnt: the first one has reserve
SQUARE_SHARE = 0.25  # of the variance of calibration that grows with the force: scale and squareness, not bias
HOLE_ROOM = 0.15  # m, swing across the hole that nothing in a hole has
CURVE_TIME, CURVE_MOST = 5.0, 0.01  # s, memory of the axis; rad/s, rate of its turning that no hole asks for


@compiled
def follow_swing(
    k: Array, x: Array, P: Array, st: Array, C: Array, dt: float, ax: float, ay: float, az: float
) -> None:  # fmt: skip
    """Swing of the point that stays: position after three high-passes, power along the axis, across, and upright."""
    share = dt / (k[K_SWING_TIME] + dt)
    leak = dt / k[K_SWING_TIME]
    along, whole, upright = 0.0, 0.0, 0.0
    for j in range(3):
        a = ax if j == 0 else (ay if j == 1 else az)
        st[DRIFT + j] += dt / 3.0 * (a - st[DRIFT + j])
        st[SLOW_A + j] += share * (a - st[SLOW_A + j])
        step = dt * (a - st[SLOW_A + j])
        st[SWING_V + j] += step - leak * st[SWING_V + j]
        st[SWING_P + j] += dt * (st[SWING_V + j] - 0.5 * step) - leak * st[SWING_P + j]
        # The sensor circles with its lever arm, seen through the same three high-passes where a string turns for long;
        # the lever arm of a tool that swings by hand is a fit, and the first of them is enough.
        arm = C[j, 0] * x[N_LEVER] + C[j, 1] * x[N_LEVER + 1] + C[j, 2] * x[N_LEVER + 2]
        st[SLOW_ARM + j] += share * (arm - st[SLOW_ARM + j])
        arm -= st[SLOW_ARM + j]
        twice = arm - st[SLOW_ARM_2 + j]
        st[SLOW_ARM_2 + j] += leak * twice
        thrice = twice - st[SLOW_ARM_3 + j]
        st[SLOW_ARM_3 + j] += leak * thrice
        d = st[SWING_P + j] - (thrice if st[TURNING] > TURNING_FROM else arm)
        along += C[j, 0] * d
        whole += d * d
        upright = d
    # A young mean forgets faster: the lever arm has to be found first.
    memory = min(3.0 * k[K_SWING_MEMORY], 0.3 * st[SETTLED])
    st[SWING_Z] += dt / (memory + max(dt, 1e-9)) * (upright * upright - st[SWING_Z])
    # Tilt not yet found swings the position as well; the tool's own swing is learnt when tilt is known.
    if st[CLIPPING] == 0.0 and P[TILT, TILT] + P[TILT + 1, TILT + 1] < 0.0025:
        share = dt / (k[K_SWING_MEMORY] + dt)
        st[SWING_X] += share * (along * along - st[SWING_X])
        st[SWING_C] += share * (0.5 * max(whole - along * along, 0.0) - st[SWING_C])


@compiled
def follow_shocks(
    k: Array, P: Array, st: Array, dt: float, ax: float, ay: float, az: float, power: float, clipped: bool
) -> None:
    """
    A force far above the usual may be a shock whose tip was cut off before the sensor averaged it.

    Velocity is lost then, mostly along the force that is shown: that goes into its variance at once.
    """
    st[SHOCKS] -= dt / SHOCK_MEMORY * st[SHOCKS]
    st[SINCE_SHOCK] += dt
    # A sample that is a mean of dt shows no less than the share of it that was clipped.
    shown = k[K_ACCEL_RANGE] * min(HIDDEN / max(dt, 1e-4), 0.9)
    unusual = power > k[K_SHOCK_AT] ** 2 * st[STRONG] + 100.0 and st[STRONG] > 0.0
    if clipped or (unusual and power > shown * shown):
        if unusual and st[SINCE_SHOCK] > 0.1:
            st[SHOCKS] += 1.0
        st[SINCE_SHOCK] = 0.0
        lost = (k[K_SHOCK_NOISE] * dt) ** 2
        for j in range(3):
            aj = ax if j == 0 else (ay if j == 1 else az)
            P[VEL + j, VEL + j] += 0.1 * lost * power
            for m in range(3):
                P[VEL + j, VEL + m] += lost * aj * (ax if m == 0 else (ay if m == 1 else az))
    st[STRONG] += min(1.0, dt / 0.3) * (min(power, 1e4) - st[STRONG])


@compiled
def follow_rates(
    k: Array, s: Array, st: Array, dt: float, wx: float, wy: float, wz: float, clip_cross: bool
) -> None:  # fmt: skip
    """Noise of the attitude from errors in proportion to the rates, from clipping and from samples that are missing."""
    s[S_TURN] += (k[K_RATE_NOISE] ** 2 * (wy * wy + wz * wz) + k[K_ROTARY_NOISE] ** 2 * wx * wx) * dt
    if clip_cross:
        s[S_TURN] += (k[K_CLIP_TURN] * dt) ** 2
    # A stretch much longer than usual (lost samples): how rates and forces went on meanwhile is known roughly.
    if st[PERIOD] > 0.0 and dt > 1.6 * st[PERIOD]:
        rate = abs(wx - st[LAST_W]) + abs(wy - st[LAST_W + 1]) + abs(wz - st[LAST_W + 2]) + 0.05
        s[S_TURN] += (0.5 * rate * dt) ** 2
        s[S_JUMP] += st[STRONG] * dt * dt
    st[PERIOD] = dt if st[PERIOD] == 0.0 else st[PERIOD] + 0.05 * (dt - st[PERIOD])


@compiled
def split_tilt(P: Array, ax: float, ay: float) -> float:
    """Take the tilt that changes inclination out of P, axis (ax, ay) level; returns its variance, rad^2."""
    norm = math.sqrt(max(ax * ax + ay * ay, 1e-9))
    ax, ay = ax / norm, ay / norm
    variance: float = P[TILT, TILT] * ay * ay - 2.0 * P[TILT, TILT + 1] * ax * ay + P[TILT + 1, TILT + 1] * ax * ax
    for j in range(ERRORS):
        a = ax * P[TILT, j] + ay * P[TILT + 1, j]
        P[TILT, j], P[TILT + 1, j] = ax * a, ay * a
    for j in range(ERRORS):
        a = ax * P[j, TILT] + ay * P[j, TILT + 1]
        P[j, TILT], P[j, TILT + 1] = ax * a, ay * a
    return variance


@compiled
def join_tilt(P: Array, ax: float, ay: float, variance: float) -> None:
    """Put a tilt that changes inclination into P, axis (ax, ay) level; variance in rad^2."""
    norm2 = max(ax * ax + ay * ay, 1e-9)
    P[TILT, TILT] += variance * ay * ay / norm2
    P[TILT + 1, TILT + 1] += variance * ax * ax / norm2
    P[TILT, TILT + 1] -= variance * ax * ay / norm2
    P[TILT + 1, TILT] = P[TILT, TILT + 1]


@compiled
def follow_clipping(
    k: Array, x: Array, P: Array, st: Array, kept: Array, C: Array, dt: float, wx: float, clip_x: bool
) -> bool:  # fmt: skip
    """
    While the x gyro clips, what it misses is a state that starts with the slope the rate had.

    What is known of the sensors and of inclination is set aside meanwhile, lest a roll gone astray spoil it: the gyros
    across the axis keep it. True if roll is lost.
    """
    lost = False
    if clip_x:
        if st[CLIPPING] == 0.0:
            x[N_MISSING] = 0.0
            # The low-passed slope is late by its time constant.
            x[N_SLOPE] = st[RATE_SLOPE] + SLOPE_LAG * st[RATE_CURVE]
            P[SLOPE, SLOPE] = k[K_CLIP_SLOPE] ** 2
            for j in range(MISSING - BIAS):
                for m in range(MISSING - BIAS):
                    kept[j, m] = P[BIAS + j, BIAS + m]
            for j in range(ERRORS):
                for m in range(BIAS, MISSING):
                    P[j, m] = 0.0
                    P[m, j] = 0.0
            st[CLIP_TILT] = split_tilt(P, C[0, 0], C[1, 0])
        st[CLIPPING] = 1.0 if wx > 0.0 else -1.0
        # It bends back as it did before; a rate that was not yet bending must, sooner or later.
        bend = max(-st[CLIPPING] * st[RATE_CURVE], 0.2 * k[K_CLIP_CURVE])
        # A string that swings about its mean speed bends in proportion to the distance from it.
        bend *= 1.0 + abs(x[N_MISSING]) / max(abs(wx) - st[TURNING], 0.1 * abs(wx))
        x[N_SLOPE] -= st[CLIPPING] * bend * dt
        x[N_MISSING] += x[N_SLOPE] * dt
        st[CLIP_TIME] += dt
        if x[N_MISSING] * wx < 0.0:
            x[N_MISSING] = 0.0
    else:
        # When the gyro is back nothing is missing: if the state says otherwise it went astray, and roll with it.
        astray = abs(x[N_MISSING]) > k[K_LOST]
        x[N_MISSING] = 0.0
        x[N_SLOPE] = 0.0
        for j in range(ERRORS):
            for m in range(BIAS, ERRORS):
                P[j, m] = 0.0
                P[m, j] = 0.0
        for j in range(MISSING - BIAS):
            for m in range(MISSING - BIAS):
                P[BIAS + j, BIAS + m] = kept[j, m]
        join_tilt(P, C[0, 0], C[1, 0], st[CLIP_TILT])
        st[CLIP_TILT] = 0.0
        st[CLIPPING] = 0.0
        st[RATE_SLOPE] = 0.0
        st[RATE_CURVE] = 0.0
        lost = astray or st[CLIP_TIME] > k[K_CLIP_BRIDGE] or P[TILT, TILT] + P[TILT + 1, TILT + 1] > 9.0
        st[CLIP_TIME] = 0.0
    return lost


@compiled
def follow_slope(st: Array, dt: float, wx: float) -> None:
    """Slope and curvature of the x rate, low-passed, with which clipping would begin."""
    if dt > 0.0:
        late = st[RATE_SLOPE]
        st[RATE_SLOPE] += dt / (SLOPE_LAG + dt) * ((wx - st[LAST_W]) / dt - late)
        st[RATE_CURVE] += dt / (CURVE_LAG + dt) * ((st[RATE_SLOPE] - late) / dt - st[RATE_CURVE])


@compiled
def noises(k: Array, s: Array, st: Array, white: float, density: float) -> tuple[float, float, float]:
    """
    Variances of an interval that follow the motion: velocity, wander of the point, and its play.

    white, density: swing, m^2, and density, (m/s^2)^2 s, of white force (`gravity_bounded_white`).
    """
    T = s[S_TIME]
    motion = max(max(st[SWING_X], st[SWING_C]) - white, 0.0)
    force = (k[K_ACCEL_NOISE] ** 2 + density) * T + s[S_JUMP] / 3.0
    wander = (k[K_ANCHOR] ** 2 + k[K_ANCHOR_SWING] ** 2 * motion) * T
    play = k[K_PLAY] ** 2 + k[K_PLAY_SWING] ** 2 * motion
    return force, wander, play


@compiled
def jump_gate(k: Array, st: Array) -> float:
    """Square of an innovation over its variance beyond which it is a velocity lost: only where shocks are frequent."""
    return k[K_SHOCK_GATE] * max(st[USUAL], JUMP_FROM) if st[SHOCKS] > SHOCKS_FROM else NEVER


@compiled
def follow_innovations(
    k: Array, P: Array, st: Array, C: Array, T: float, turn: float, i0: float, i1: float, i2: float, square: float
) -> tuple[float, float]:
    """
    What the whitened innovation (level x, y, down; mean square) of an update says of the filter itself.

    T, turn: time since the last update and variance its rates added to the tilt. Returns the power of the innovations
    over the filter's own time, along the hole and across it, 1 expected; NaN while the x gyro clips.
    """
    st[SETTLED] += T
    st[UNSETTLED] -= T / k[K_SWING_TIME] * st[UNSETTLED]
    st[USUAL] += T / 10.0 * (min(square, 9.0 * st[USUAL] + 0.001) - st[USUAL])
    # Those that lean one way for long are a bias on the move; white ones leave this mean at T / time.
    share = T / k[K_LEAN_TIME]
    st[LEAN] += share * (i0 - st[LEAN])
    st[LEAN + 1] += share * (i1 - st[LEAN + 1])
    lean = (st[LEAN] ** 2 + st[LEAN + 1] ** 2) / share
    st[BOOST] = k[K_LEAN_GAIN] * max(0.0, lean - k[K_LEAN_FROM] - ALIAS_LEAN * st[ALIAS])
    # Tilt is disturbed by what the updates put into it. Summed over the time in which the tilt's variance grows by half
    # of itself they have that variance if all is white as assumed, and are the error itself if it is vibration.
    near = (P[TILT, TILT] + P[TILT + 1, TILT + 1]) * T / turn
    # Heave along the hole slows the filter beyond the longest sum; what is summed then is between the two.
    heaves = st[SWING_X] > max(HEAVE, 4.0 * st[SWING_C])
    colour = math.pow(NEAR_MOST / max(near, NEAR_MOST), 1.0 / 3.0) if heaves else 1.0
    near = min(max(near, NEAR_LEAST), NEAR_LEAST + NEAR_AGE * st[SETTLED], NEAR_MOST)
    share = min(1.0, T / near)
    st[NEAR_LEAN] += share * (i0 - st[NEAR_LEAN])
    st[NEAR_LEAN + 1] += share * (i1 - st[NEAR_LEAN + 1])
    along, across = math.nan, math.nan
    if st[CLIPPING] == 0.0:
        # An acceleration along the hole is the tilt that inclination sees, one across it the tilt of the toolface.
        ax, ay = C[0, 0], C[1, 0]
        across2 = max(ax * ax + ay * ay, 1e-9)
        along = colour * 2.0 / share * (ax * st[NEAR_LEAN] + ay * st[NEAR_LEAN + 1]) ** 2 / across2
        across = 2.0 / share * (ay * st[NEAR_LEAN] - ax * st[NEAR_LEAN + 1]) ** 2 / across2
        share = T / min(SCALE_TIME + 2.0 * near, SCALE_YOUNG + SCALE_AGE * st[SETTLED])
        st[SCALE_ALONG] += share * (along - st[SCALE_ALONG])
        st[SCALE_ACROSS] += share * (across - st[SCALE_ACROSS])
        _follow_steady(st, C, T, near, colour, i0, i1)
    st[LEAN_DOWN] += T / DOWN_TIME * (i2 - st[LEAN_DOWN])
    st[SCALE_DOWN] += T / SCALE_TIME * (2.0 * DOWN_TIME / T * st[LEAN_DOWN] ** 2 - st[SCALE_DOWN])
    return along, across


@compiled
def _follow_steady(st: Array, C: Array, T: float, near: float, colour: float, i0: float, i1: float) -> None:
    """Power, in units of that of the innovations, that those of one sign for long have; T, near: as there."""
    memory = min(STEADY_TIME, 0.5 * st[SETTLED])
    for j in range(2):
        st[SLOW_LEAN + j] += T / memory * ((i0 if j == 0 else i1) - st[SLOW_LEAN + j])
    ax, ay = C[0, 0], C[1, 0]
    power = 2.0 * near / T / max(ax * ax + ay * ay, 1e-9)
    # Those that are of one sign by chance have their part of it; soon after a start nothing is known to be steady.
    chance = near / memory
    known = st[SETTLED] / (STEADY_AGE + st[SETTLED]) / max(1.0 - chance, 0.1)
    along = colour * power * (ax * st[SLOW_LEAN] + ay * st[SLOW_LEAN + 1]) ** 2
    across = power * (ay * st[SLOW_LEAN] - ax * st[SLOW_LEAN + 1]) ** 2
    st[STEADY_ALONG] = min(known * max(along - chance * st[SCALE_ALONG], 0.0), st[SCALE_ALONG])
    st[STEADY_ACROSS] = min(known * max(across - chance * st[SCALE_ACROSS], 0.0), st[SCALE_ACROSS])


@compiled
def vertical_excess(st: Array) -> float:
    """
    Power that the vertical innovations have too much of, to be added to that of the others.

    Neither tilt nor gyros have a say in the vertical: what runs there is the accelerometer itself, out of scale or out
    of square from one attitude to the next, and the horizontal, where the tilt makes up for it, does not show it.
    """
    # White forces run there as well, and need no accelerometer out of scale.
    return (1.0 - st[ALIAS]) * max(0.0, st[SCALE_DOWN] - DOWN_FROM)  # type: ignore[no-any-return]


@compiled
def error_shares(st: Array) -> tuple[float, float]:
    """
    Shares of the power of the innovations, along the hole and across it, that are error.

    Innovations of one sign for long tell of a bias on the move: their sum is twice the tilt that lags behind it. White
    forces have such innovations by chance.
    """
    part = TWICE * (1.0 - st[ALIAS])
    return (
        1.0 - part * st[STEADY_ALONG] / max(st[SCALE_ALONG], 1e-12),
        1.0 - part * st[STEADY_ACROSS] / max(st[SCALE_ACROSS], 1e-12),
    )


@compiled
def believed(k: Array, st: Array) -> tuple[float, float]:
    """Factors of the covariance, along the hole and across it, with reserve."""
    apart = vertical_excess(st)
    along, across = error_shares(st)
    return k[K_RESERVE] * (along * st[SCALE_ALONG] + apart), k[K_RESERVE] * (across * st[SCALE_ACROSS] + apart)


@compiled
def floors(k: Array, x: Array, P: Array, st: Array, C: Array) -> tuple[float, float]:
    """Variances that calibration leaves in inclination and in the tilt across the hole, rad^2."""
    # What the accelerometer shows too much of gravity, beyond what is known of it, it may show across it as well. What
    # is fixed across the axis averages out in a string that turns.
    gravity2 = k[K_GRAVITY] * k[K_GRAVITY]
    off = max(x[N_DOWN] ** 2 - P[DOWN, DOWN] - k[K_GRAVITY_SIGMA] ** 2, 0.0)
    floor = k[K_FLOOR] * k[K_FLOOR] + off / gravity2
    turn2 = st[TURNING] * st[TURNING]
    left = 1.0 / (1.0 + turn2 / (TURNING_FROM * TURNING_FROM))
    # Tilt that stands still in a tool that turns: gyros out of line, and the bias across the axis over the rate.
    bias2 = BIAS_SHARE * 0.5 * (P[BIAS + 1, BIAS + 1] + P[BIAS + 2, BIAS + 2])
    askew = (1.0 - left) * (k[K_ASKEW] * k[K_ASKEW] + bias2 / max(turn2, 0.01))
    # The pull of the circle that the sensor runs is across the axis it turns about; to accelerometers out of square, or
    # by gyros out of line, a share of it lies along the hole.
    pull2 = turn2 * turn2 * (x[N_LEVER + 1] ** 2 + x[N_LEVER + 2] ** 2) / gravity2
    # On its way along a curve the tool is accelerated across the hole; faster turns are none of a hole.
    ax, ay = C[0, 0], C[1, 0]
    bx, by = (ax - st[SLOW_AXIS]) / CURVE_TIME, (ay - st[SLOW_AXIS + 1]) / CURVE_TIME
    share = ((bx * bx + by * by) / CURVE_MOST**2) ** 2
    share = k[K_TRAVEL] * k[K_TRAVEL] / (gravity2 * max(ax * ax + ay * ay, 1e-6) * (1.0 + share))
    # The axis' own error is inclination's by the sine, the cross axes' by the cosine.
    upright2 = min(C[2, 0] * C[2, 0], 1.0)
    along = floor * (1.0 - upright2 * (1.0 - left)) + askew + (SQUARE_SHARE * floor + askew) * pull2
    aside = left * floor + askew * upright2
    # A hole has no room for a wide swing across it: in a string that turns that is roll out of step with the force.
    wide2 = max(st[SWING_C] - HOLE_ROOM * HOLE_ROOM, 0.0)
    aside += (1.0 - left) * wide2 / (gravity2 * k[K_SWING_TIME] ** 4)
    return along + share * (bx * ax + by * ay) ** 2, aside + share * (bx * ay - by * ax) ** 2


@compiled
def sigmas(
    ax: float, ay: float, p00: float, p01: float, p11: float, along: float, across: float, floor: float, aside: float
) -> tuple[float, float]:
    """
    One sigma of inclination and of toolface, rad, at most pi.

    ax, ay: the tool axis, level; p00, p01, p11: covariance of the tilt, rad^2, to be multiplied by `along` for
    inclination, by `across` for toolface; floor, aside: variances that calibration leaves to each (`floors`), rad^2.
    """
    across2 = ax * ax + ay * ay
    if across2 > 1e-6:
        vi = along * (p00 * ay * ay - 2.0 * p01 * ax * ay + p11 * ax * ax) / across2
        vt = across * (p00 * ax * ax + 2.0 * p01 * ax * ay + p11 * ay * ay) / across2
    else:
        vi = vt = 0.25 * (along + across) * (p00 + p11)
    inclination = min(math.pi, math.sqrt(max(vi, 0.0) + floor))
    toolface = min(math.pi, math.sqrt((max(vt, 0.0) + aside) / max(across2, 1e-6)))
    return inclination, toolface
