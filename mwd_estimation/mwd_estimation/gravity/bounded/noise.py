"""
Whether forces are white: what point samples fold down, or what a simulator adds to each of them.

Vibration integrates to a bounded velocity; force that is white down to a few Hz does not, each sample of it is noise to
the velocity. Which of the two it is shows in the spectrum: differences of neighbours (top of the band), of blocks (some
Hz) and the swing of the vertical (below) agree if it is white. Derivation: ``docs/gravity_bounded.md``.
"""

from __future__ import annotations

from mwd_estimation.gravity.bounded.mechanisation import N_LEVER, S_FORCE, S_TIME
from mwd_estimation.gravity.bounded.motion import (
    ALIAS,
    BLOCK,
    BLOCK_TIME,
    LAST_BLOCK,
    ROUGH,
    SETTLED,
    SLOW_ROUGH,
    SWING_Z,
    TURNING,
    UNSETTLED,
)  # fmt: skip
from mwd_estimation.gravity.bounded.params import K_ALIAS_NOISE, K_GRAVITY, K_SWING_TIME
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.compiled import compiled

BLOCK_LENGTH, BLOCK_MEMORY = 0.15, 4.0  # s, of the means whose differences show the density at a few Hz
QUIET = 0.002  # (m/s^2)^2 s, density below which it does not matter
SWING_LEAST, SWING_MOST = 0.45, 3.0  # swing as a multiple of the explained that is white
SWING_NONE = 0.1  # and below which there is none, once there is enough to judge by
BLOCK_LEAST, BLOCK_MOST = 0.65, 1.8  # the same of the density at a few Hz
COLOUR = 0.8  # and how far beyond that it is not white for sure
FIRST = 0.6  # s, before which nothing is judged
RISE, FALL, FALL_SWING, FALL_SLOW, FALL_LIKE = 3.0, 0.3, 1.0, 6.0, 20.0  # s, how fast the verdict changes
WHITE_FROM, WHITE_AT = 0.25, 0.5  # verdict from which, and at which, all roughness counts
RESERVE = 2.0  # density that counts, as a multiple of roughness, where the verdict is white
FORCE_SHARE = 0.1  # share of gravity that the noise of the force may have in an interval before it is left out


@compiled
def explained_swing(k: Array, st: Array) -> float:
    """Swing, m^2, that forces would leave that are as white as neighbouring samples say."""
    # White force of density one leaves the variance time^3 / 16 after the high-pass and the two leaky integrations.
    return k[K_SWING_TIME] ** 3 / 16.0 * st[ROUGH]  # type: ignore[no-any-return]


@compiled
def follow_white(k: Array, x: Array, s: Array, st: Array) -> tuple[float, float]:
    """
    Follow the verdict over one interval; returns the swing, m^2, that is white, and the density that counts as noise.

    The density is that of the velocity's random walk, (m/s^2)^2 s.
    """
    _follow_blocks(s, st)
    T = s[S_TIME]
    explained = explained_swing(k, st)
    settled = 1.0 - st[UNSETTLED]
    # As it would be had the high-pass settled.
    swing = st[SWING_Z] / max(settled * settled * settled, 1e-4)
    # A sensor off the axis of a string that turns runs a circle, which blocks see.
    pull2 = st[TURNING] ** 4 * (x[N_LEVER + 1] ** 2 + x[N_LEVER + 2] ** 2)
    circle = 0.5 * pull2 * BLOCK_LENGTH
    least, most = BLOCK_LEAST * st[ROUGH], BLOCK_MOST * st[ROUGH] + circle
    like_white = least < st[SLOW_ROUGH] < most
    aliased = like_white and SWING_LEAST * explained < swing < SWING_MOST * explained
    # Few swings and few blocks say little.
    few = st[SETTLED] / (1.0 + st[SETTLED]) if st[SETTLED] > FIRST else 0.0
    coloured = st[SLOW_ROUGH] < few * COLOUR * least or few * COLOUR * st[SLOW_ROUGH] > most
    calm = swing < SWING_NONE * few * few * explained
    if st[ROUGH] < QUIET or coloured or (calm and not like_white):
        st[ALIAS] -= T / FALL * st[ALIAS]
    elif calm:
        st[ALIAS] -= T / FALL_SWING * st[ALIAS]
    elif aliased:
        st[ALIAS] += T / RISE * (1.0 - st[ALIAS])
    else:
        st[ALIAS] -= T / (FALL_LIKE if like_white else FALL_SLOW) * st[ALIAS]
    surely = min(max((st[ALIAS] - WHITE_FROM) / (WHITE_AT - WHITE_FROM), 0.0), 1.0)
    # Where it is not sure, as much of the swing as roughness can explain. The vertical shows it: tilt errors, which
    # swing too, do not reach it to first order.
    white = min(swing, explained)
    counts = k[K_ALIAS_NOISE] ** 2 * white * 16.0 / k[K_SWING_TIME] ** 3
    return white, surely * RESERVE * st[ROUGH] + (1.0 - surely) * counts


@compiled
def _follow_blocks(s: Array, st: Array) -> None:
    """Density of the forces at a few Hz, from the differences of means."""
    st[BLOCK_TIME] += s[S_TIME]
    for j in range(3):
        st[BLOCK + j] += s[S_FORCE + j]
    if st[BLOCK_TIME] >= BLOCK_LENGTH:
        power = 0.0
        for j in range(3):
            mean = st[BLOCK + j] / st[BLOCK_TIME]
            power += (mean - st[LAST_BLOCK + j]) ** 2 / 6.0
            st[LAST_BLOCK + j] = mean
            st[BLOCK + j] = 0.0
        if st[SETTLED] > 1.5 * BLOCK_LENGTH:
            share = st[BLOCK_TIME] / min(BLOCK_MEMORY, st[SETTLED] - BLOCK_LENGTH)
            st[SLOW_ROUGH] += share * (power * st[BLOCK_TIME] - st[SLOW_ROUGH])
        st[BLOCK_TIME] = 0.0


@compiled
def leave_out_noise(k: Array, s: Array, density: float) -> None:
    """
    Take the noise out of the force through which tilt acts on velocity.

    It acts through the force there is, of which white noise is no part: what is not gravity is believed by its share.
    """
    pull = k[K_GRAVITY] * s[S_TIME]
    share = 1.0 / (1.0 + density * s[S_TIME] / (FORCE_SHARE * pull * pull))
    s[S_FORCE] *= share
    s[S_FORCE + 1] *= share
    s[S_FORCE + 2] = share * s[S_FORCE + 2] - (1.0 - share) * pull
