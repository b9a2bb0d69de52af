"""Raw accelerometer as a gravity method: the row every other method is compared with; no gyro, no memory of motion."""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mwd_estimation.core import samples as track
from mwd_estimation.core.samples import Track
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

_REJECTED, _GAP, _CLIPPED = int(Status.REJECTED), int(Status.GAP), int(Status.CLIPPED)
_NEAR_VERTICAL, _INITIALISING = int(Status.NEAR_VERTICAL), int(Status.INITIALISING)

G, NON_GRAVITY, POWER, REALS = 0, 3, 4, 5


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the raw method."""

    gravity: float = setting(STANDARD_GRAVITY, "magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)
    gap: float = setting(0.5, "a longer silence is flagged", unit="s", low=0.01, high=60.0)
    memory: float = setting(2.0, "time over which the disturbance is averaged for sigma", unit="s", low=0.01, high=60.0)
    accel_range: float = setting(156.9, "force at which the accelerometer clips", unit="m/s^2", low=10.0, high=4000.0)
    sigma_floor: float = setting(0.003, "sigma is not given smaller", unit="rad", low=0.0, high=0.5)


@dataclasses.dataclass
class State:
    """Common clock and motion; last direction, non-gravity and its mean square."""

    clock: Stamps
    motion: Array
    reals: Array

    def copy(self) -> State:
        """Independent copy."""
        return copy.deepcopy(self)


def initial(params: Params) -> State:  # noqa: ARG001  (every method has this signature)
    """State before the first sample."""
    reals = np.zeros(REALS)
    reals[G : G + 3] = np.nan
    reals[POWER] = 1e6
    return State(np.zeros(track.CLOCK_SIZE, dtype=np.int64), np.zeros(track.MOTION_SIZE), reals)


def run(params: Params, state: State, stamp_ns: ArrayLike, gyro_t: ArrayLike, accel_t: ArrayLike) -> Track:
    """
    Direction of minus the specific force, sample by sample; arguments and errors as `gravity_s3.run`.

    Sigma takes the disturbance across gravity to be as large as the change of magnitude it shows along gravity.
    """
    stamps, gyro, accel = track.samples(stamp_ns, gyro_t, accel_t)
    out = Track.empty(len(stamps))
    _run(
        params.gravity, params.memory, params.accel_range, params.sigma_floor, round(params.gap * 1e9),
        state.clock, state.motion, state.reals, stamps, gyro, accel,
        out.g_t, out.sigma_inclination, out.sigma_toolface, out.non_gravity, out.rotary_speed, out.status,
    )  # fmt: skip
    return out


@compiled
def _run(
    gravity: float,
    memory: float,
    accel_range: float,
    floor: float,
    gap_ns: int,
    clock: Stamps,
    motion: Array,
    s: Array,
    stamps: Stamps,
    gyro: Array,
    accel: Array,
    g_out: Array,
    inc_out: Array,
    tf_out: Array,
    force_out: Array,
    rotary_out: Array,
    status_out: NDArray[np.uint32],
) -> None:
    for i in range(len(stamps)):
        fx, fy, fz = accel[i, 0], accel[i, 1], accel[i, 2]
        before = clock[track.LAST_NS]
        verdict = track.admit(clock, stamps[i], gyro[i, 0], gyro[i, 1], gyro[i, 2], fx, fy, fz, gap_ns)
        bits = 0
        norm = math.sqrt(fx * fx + fy * fy + fz * fz)
        if verdict == track.REJECTED or norm == 0.0:
            bits = _REJECTED
            if not math.isfinite(s[G]):
                bits |= _INITIALISING
        else:
            dt = 1e-9 * (stamps[i] - before) if verdict == track.NEXT else 0.0
            if verdict == track.AFTER_GAP:
                bits |= _GAP
            if max(abs(fx), abs(fy), abs(fz)) >= accel_range:
                bits |= _CLIPPED
            s[G], s[G + 1], s[G + 2] = -fx / norm, -fy / norm, -fz / norm
            s[NON_GRAVITY] = abs(norm - gravity)
            share = dt / (memory + dt) if dt > 0.0 else 1.0
            s[POWER] += share * (s[NON_GRAVITY] * s[NON_GRAVITY] - s[POWER])
            bits |= track.follow_motion(motion, dt, gyro[i, 0], gyro[i, 1], gyro[i, 2], s[NON_GRAVITY])
        sigma = min(math.pi, math.sqrt(s[POWER] / (gravity * gravity) + floor * floor))
        across = math.hypot(s[G + 1], s[G + 2])
        if across < math.sin(track.NEAR_VERTICAL_BELOW):
            bits |= _NEAR_VERTICAL
        for c in range(3):
            g_out[i, c] = s[G + c]
        inc_out[i] = sigma
        tf_out[i] = min(math.pi, sigma / max(across, 1e-3))
        force_out[i] = motion[track.PEAK_FORCE]
        rotary_out[i] = motion[track.ROTARY]
        status_out[i] = bits
