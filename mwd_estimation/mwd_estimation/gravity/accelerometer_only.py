# SPDX-License-Identifier: Apache-2.0
"""
Accelerometer alone as a gravity method: the baseline with which every other method is compared.

Down is minus the direction of the specific force, sample by sample, without a gyro and without memory. This method also
takes over when the gyros are faulty (`fallback`). Limits: ``docs/methods/fuzzy_mahony.md``.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import track
from mwd_estimation.core.status import Status
from mwd_estimation.core.track import Track
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.records import dtype_of

_INITIALISING = int(Status.INITIALISING)

State = NDArray[np.void]
"""One record with the fields of `Record`, shape (1,); a run can continue from a copy."""


class Params(NamedTuple):
    """Settings of the accelerometer-only method."""

    gravity: float = STANDARD_GRAVITY  #: magnitude of local gravity, m/s^2
    memory: float = 2.0  #: averaging time of the disturbance, from which sigma is computed, s
    accel_range: float = 16.0 * STANDARD_GRAVITY  #: force at which the accelerometer clips, m/s^2
    sigma_floor: float = 0.003  #: smallest sigma, rad


class Record:
    """Common clock and motion, last direction down, and mean square error of the force's magnitude, (m/s^2)^2."""

    clock: track.Clock
    motion: track.Motion
    down: Annotated[Array, 3]
    power: float


RECORD = dtype_of(Record)


def initial(params: Params) -> State:  # noqa: ARG001  (every method has this signature)
    """Return the state before the first sample."""
    state = np.zeros(1, RECORD)
    state["down"] = np.nan
    state["power"] = 1e6
    return state


def run(params: Params, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """
    Return minus the direction of the specific force, sample by sample; arguments and errors as for `fuzzy_mahony.run`.

    Sigma assumes that the disturbance across gravity is as large as the observed change of magnitude along gravity.
    """
    stamps, gyro, accel = track.sample_arrays(stamp_ns, gyro_t, accel_t)
    out = Track.empty(len(stamps))
    _run(params, state[0], stamps, gyro, accel, out)
    return out


@compiled
def _run(p: Params, s: Any, stamps: Stamps, gyro: Array, accel: Array, out: Track) -> None:
    for i in range(len(stamps)):
        w, f = (gyro[i, 0], gyro[i, 1], gyro[i, 2]), (accel[i, 0], accel[i, 1], accel[i, 2])
        # The gyro is not used, so its clipping is ignored.
        verdict, dt, bits = track.take(s.clock, stamps[i], w, f, track.GAP_NS, math.inf, p.accel_range)
        if verdict == track.REJECTED:
            if not math.isfinite(s.down[0]):
                bits |= _INITIALISING
        else:
            if verdict != track.NEXT:
                dt = 0.0
            norm = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
            for c in range(3):
                s.down[c] = -f[c] / norm
            non_gravity = abs(norm - p.gravity)
            share = dt / (p.memory + dt) if dt > 0.0 else 1.0
            s.power += share * (non_gravity * non_gravity - s.power)
            bits |= track.follow_motion(s.motion, dt, w, non_gravity)
        sigma = min(math.pi, math.sqrt(s.power / (p.gravity * p.gravity) + p.sigma_floor * p.sigma_floor))
        for c in range(3):
            out.g_t[i, c] = s.down[c]
        track.write_row(out, i, math.hypot(s.down[1], s.down[2]), sigma, s.motion, bits)
