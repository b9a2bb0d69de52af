"""
Settings of the bounded filter, for people and for the kernel.

`Params` is what is set; `constants` lays it out as the array `k` that the kernels index by the K_ names.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting

(
    K_GRAVITY, K_START, K_UPDATE, K_GYRO_NOISE, K_RATE_NOISE, K_ROTARY_NOISE, K_BIAS_WALK, K_BIAS_FAST,
    K_ACCEL_NOISE, K_ANCHOR, K_PLAY, K_SWING_TIME, K_SWING_MEMORY, K_ANCHOR_SWING, K_PLAY_SWING,
    K_ALIAS_NOISE, K_SHOCK_AT, K_SHOCK_NOISE, K_SHOCK_GATE, K_GYRO_RANGE, K_ACCEL_RANGE,
    K_CLIP_JERK, K_CLIP_SLOPE, K_BIAS_0, K_SCALE_0, K_LEVER_0, K_DOWN_0, K_FLOOR, K_CONING,
    K_CLIP_TURN, K_LEAN_TIME, K_LEAN_GAIN, K_LEAN_FROM, K_CLIP_BRIDGE, K_CLIP_CURVE, K_LOST, K_RESERVE, K_ASKEW,
    K_GRAVITY_SIGMA, K_TRAVEL, K_SAMPLED, K_BRIDGE, SETTINGS,
) = range(43)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Params:
    """Settings of the bounded filter; none needs to be touched for a new tool, all may be."""

    gravity: float = setting(STANDARD_GRAVITY, "magnitude of local gravity", unit="m/s^2", low=9.0, high=10.5)
    start: float = setting(0.3, "mean in gyro axes that makes the first estimate", unit="s", low=0.02, high=10.0)
    gap: float = setting(
        0.25, "a silence as long, or half that and four times the usual step, is bridged", unit="s", low=0.01, high=10.0
    )
    bridge: float = setting(10.0, "one as long as this starts the attitude anew", unit="s", low=0.0, high=600.0)
    update: float = setting(0.04, "time between updates of the covariance", unit="s", low=0.001, high=0.2)
    coning: float = setting(
        0.0,
        "share of the 1/12 coning term: 1 for mean rates, 0 where the sensor strapdown-integrates",
        low=0.0,
        high=1.0,
    )
    sampled: bool = setting(
        False, "rates are point samples, not means; found out without it where vibration folds down"
    )
    gyro_noise: float = setting(0.00071, "gyro white noise with reserve", unit="rad/s/sqrt(Hz)", low=1e-7, high=0.1)
    rate_noise: float = setting(0.0012, "noise per rate across the axis (scale, misalignment)", low=0.0, high=0.1)
    rotary_noise: float = setting(0.0001, "noise per rate about the axis (its scale is a state)", low=0.0, high=0.1)
    bias_walk: float = setting(0.00013, "random walk of the gyro bias", unit="rad/s/sqrt(s)", low=0.0, high=0.01)
    bias_fast: float = setting(
        0.00045,
        "largest random walk while the innovations lean one way (warming up)",
        unit="rad/s/sqrt(s)",
        low=0.0,
        high=0.1,
    )
    lean_time: float = setting(
        12.0, "time over which innovations that lean one way are averaged", unit="s", low=0.5, high=60.0
    )
    lean_from: float = setting(
        1.5, "lean, as a multiple of what white innovations leave, that speeds the walk", low=1.0, high=100.0
    )
    lean_gain: float = setting(330.0, "growth of the walk's variance per lean beyond that", low=0.0, high=1e6)
    accel_noise: float = setting(
        0.014, "accelerometer white noise with reserve", unit="m/s^2/sqrt(Hz)", low=1e-5, high=1.0
    )
    anchor: float = setting(0.001, "least wander of the point the tool hangs at", unit="m/sqrt(s)", low=1e-5, high=10.0)
    play: float = setting(0.0038, "least play about that point", unit="m", low=1e-5, high=10.0)
    swing_time: float = setting(
        0.7, "time constant of the high-pass that shows the swing", unit="s", low=0.1, high=20.0
    )
    swing_memory: float = setting(2.1, "time over which the swing is averaged", unit="s", low=0.1, high=60.0)
    anchor_swing: float = setting(2.7, "wander per swing", unit="1/sqrt(s)", low=0.0, high=100.0)
    play_swing: float = setting(0.1, "play per swing", low=0.0, high=100.0)
    alias_noise: float = setting(
        0.4, "share of the white force noise that swing and roughness agree on", low=0.0, high=100.0
    )
    shock_at: float = setting(2.2, "a force that many times the usual may hide clipping", low=1.0, high=100.0)
    shock_noise: float = setting(2.0, "velocity lost in such a sample per velocity shown", low=0.0, high=100.0)
    shock_gate: float = setting(
        6.0,
        "innovation power, as a multiple of the usual, that shows a velocity lost, where shocks are frequent",
        low=1.0,
        high=1e6,
    )
    gyro_range: float = setting(34.9, "rate at which the gyro clips", unit="rad/s", low=0.1, high=200.0)
    accel_range: float = setting(156.9, "force at which the accelerometer clips", unit="m/s^2", low=10.0, high=4000.0)
    clip_jerk: float = setting(
        200.0, "random walk of the slope of a clipped rate", unit="rad/s^2/sqrt(s)", low=0.0, high=1e4
    )
    clip_slope: float = setting(15.0, "error of that slope when clipping begins", unit="rad/s^2", low=0.0, high=1e4)
    clip_turn: float = setting(5.0, "rate lost while a cross-axis gyro clips", unit="rad/s", low=0.0, high=100.0)
    clip_bridge: float = setting(
        4.0,
        "longest clipping of the x gyro that is bridged; after a longer one roll starts anew",
        unit="s",
        low=0.0,
        high=10.0,
    )
    clip_curve: float = setting(
        75.0, "usual curvature of a rate that clips, a fifth of it the least", unit="rad/s^3", low=0.0, high=1e4
    )
    lost: float = setting(
        3.0, "missing rate at the end of clipping that shows roll astray", unit="rad/s", low=0.01, high=100.0
    )
    bias_sigma: float = setting(0.005, "gyro bias at switch-on", unit="rad/s", low=1e-6, high=0.2)
    scale_sigma: float = setting(0.003, "scale error of the x gyro at switch-on", low=1e-6, high=0.2)
    lever_sigma: float = setting(0.1, "lever arm of the sensor from the point that stays", unit="m", low=1e-4, high=5.0)
    down_sigma: float = setting(
        0.05, "error of gravity's magnitude as the sensor shows it", unit="m/s^2", low=1e-6, high=1.0
    )
    calibration_sigma: float = setting(
        0.00017, "tilt that calibration errors of the accelerometer leave", unit="rad", low=0.0, high=0.5
    )
    turning_sigma: float = setting(
        0.0003, "tilt fixed in a turning tool: gyros out of line with the accelerometers", unit="rad", low=0.0, high=0.5
    )
    gravity_sigma: float = setting(
        0.03, "how well `gravity` is known; the spread of latitudes by default", unit="m/s^2", low=1e-5, high=0.5
    )
    travel: float = setting(
        0.5, "usual speed along the hole, which in a curve is an acceleration", unit="m/s", low=0.0, high=10.0
    )
    sigma_reserve: float = setting(
        1.15, "variance published, as a multiple of what the lean of the innovations shows", low=0.1, high=100.0
    )


def constants(params: Params) -> Array:
    """Settings as the kernel takes them, in the order of the K_ names."""
    p = params
    return np.array(
        [
            p.gravity, p.start, p.update, p.gyro_noise, p.rate_noise, p.rotary_noise, p.bias_walk, p.bias_fast,
            p.accel_noise, p.anchor, p.play, p.swing_time, p.swing_memory, p.anchor_swing, p.play_swing,
            p.alias_noise, p.shock_at, p.shock_noise, p.shock_gate, p.gyro_range, p.accel_range,
            p.clip_jerk, p.clip_slope, p.bias_sigma, p.scale_sigma, p.lever_sigma, p.down_sigma,
            p.calibration_sigma, p.coning, p.clip_turn, p.lean_time, p.lean_gain, p.lean_from,
            p.clip_bridge, p.clip_curve, p.lost, p.sigma_reserve, p.turning_sigma,
            p.gravity_sigma, p.travel, float(p.sampled), p.bridge,
        ]
    )  # fmt: skip
