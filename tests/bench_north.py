"""
Monte Carlo of north seeking against its limits: error, sigma and NEES of S1's filter and of the best one, as Markdown.

Limits: N / (We cos(latitude) sqrt(T)) for a still tool with known bias, the same over sqrt(1 - sin^2 I sin^2 azimuth)
for one that rests in two positions or turns about its axis, N / sqrt(We cos(latitude)) for one that turns for hours. T
counts from the end of levelling (3 s) and not while the tool is turned over. Every error that the settings state is
drawn: biases, leakage, lag, lead, scale. Only answers count: a run that is refused gives no azimuth.
``nice -n 10 python tests/bench_north.py [RUNS]``; 200 runs take about fifteen minutes on one core.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mwd_estimation import north_ekf, north_seek
from mwd_sensors.frames import wrap_pi

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "mwd_estimation" / "test"))
from north_signals import DEG_H, EARTH_RATE, G0, Motion, felt, motion, steady, still

Array = NDArray[np.float64]
NOISES, LATITUDES, TIMES = (0.003, 0.01, 0.05, 0.15), (0.0, 34.0, 44.0, 60.0), (60.0, 120.0, 300.0)
INCLINATION, AZIMUTH = math.radians(60.0), math.radians(40.0)
LEVELLING, RATE = 3.2, 50.0
HEAD = (
    "| method | N deg/rt h | latitude | T s | limit deg | error rms deg | sigma deg "
    "| error/limit | sigma/limit | NEES | refused |"
)
RULE = "|---|---|---|---|---|---|---|---|---|---|---|"


def summary(
    method: str, noise: float, lat: float, seconds: float, limit: float, error: Array, sigma: Array, no: int
) -> str:
    """One Markdown row; angles in rad in, deg out."""
    given = np.isfinite(error)
    error, sigma = error[given], sigma[given]
    rms, mean = float(np.sqrt(np.mean(error**2))), float(np.mean(sigma))
    nees = float(np.mean((error / sigma) ** 2))
    return (
        f"| {method} | {noise:g} | {lat:g} | {seconds:g} | {math.degrees(limit):.3f} | {math.degrees(rms):.3f} | "
        f"{math.degrees(mean):.3f} | {rms / limit:.2f} | {mean / limit:.2f} | {nees:.2f} | {no} |"
    )


def band(runs: int) -> tuple[float, float]:
    """95 % band of the mean of `runs` squared normal numbers (normal approximation)."""
    half = 1.96 * math.sqrt(2.0 / runs)
    return 1.0 - half, 1.0 + half


def seek_params(mode: str, noise: float, lat: float) -> north_seek.Params:
    """
    Precision unit: in a still tool its x gyro counts and its bias is known; turning, x is an MTi-class gyro.

    Alignment goes with the noise: 300 urad in a tactical unit, 20 urad in a navigation grade one.
    """
    quiet = mode == "still"
    return north_seek.Params(
        mode=mode,
        latitude_deg=lat,
        gyro_noise_deg_rth=noise,
        gyro_x_noise_deg_rth=noise if quiet else 0.42,
        gyro_bias_deg_h=noise / 50.0 if quiet else 1.0,
        gyro_x_bias_deg_h=noise / 50.0 if quiet else 36.0,
        scale_x_ppm=300.0 if quiet else 5000.0,
        gyro_walk_deg_h_rth=0.0,
        accel_bias_ug=20.0,
        leak_urad=300.0 if noise > 0.02 else 20.0,
        lag_sigma_ms=0.02,
        lead_sigma_ms=0.02,
    )


def turned(vectors: Array, angle: Array) -> Array:
    """Vectors, shape (n, 3), with their cross-axis part turned about x by angles, rad, shape (n,)."""
    out = vectors.copy()
    c, s = np.cos(angle), np.sin(angle)
    out[:, 1] = c * vectors[:, 1] + s * vectors[:, 2]
    out[:, 2] = c * vectors[:, 2] - s * vectors[:, 1]
    return out


def feel(clean: Motion, params: north_seek.Params, scale: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Rates and forces with every error of the settings drawn; scale: of the x gyro, one sigma."""
    x_rate = clean.gyro_t[:, 0]
    lag, lead = rng.standard_normal(2) * [params.lag_sigma_ms * 1e-3, params.lead_sigma_ms * 1e-3]
    late = dataclasses.replace(
        clean, gyro_t=turned(clean.gyro_t, -x_rate * lag), accel_t=turned(clean.accel_t, x_rate * lead)
    )
    bias, accel_bias = draw(params, rng)
    return felt(
        late, rng, params.gyro_noise_deg_rth, params.gyro_x_noise_deg_rth, params.accel_noise_ug_rthz, bias, accel_bias,
        scale_x=scale * rng.standard_normal(), leak=params.leak_urad * 1e-6 * rng.standard_normal(2),
    )  # fmt: skip


def draw(params: north_seek.Params, rng: np.random.Generator) -> tuple[Array, Array]:
    """Gyro bias, rad/s, and force bias, m/s^2, drawn from the settings' own sigmas."""
    gyro = np.array([params.gyro_x_bias_deg_h, params.gyro_bias_deg_h, params.gyro_bias_deg_h])
    return rng.standard_normal(3) * gyro * DEG_H, rng.standard_normal(3) * params.accel_bias_ug * 1e-6 * G0


def seek(mode: str, noise: float, lat: float, runs: int, seed: int) -> list[str]:
    """Rows of one mode, noise and latitude for all times."""
    params = seek_params(mode, noise, lat)
    roll = still if mode == "still" else steady(60.0)
    clean = motion(TIMES[-1] + LEVELLING, math.radians(lat), INCLINATION, AZIMUTH, roll, RATE)
    rng = np.random.default_rng(seed)
    error, sigma = np.empty((runs, len(TIMES))), np.empty((runs, len(TIMES)))
    refused = np.zeros(len(TIMES), dtype=int)
    limit = np.zeros(len(TIMES))
    blind = math.sin(INCLINATION) * math.sin(AZIMUTH)
    factor = 1.0 if mode == "still" else math.sqrt(1.0 - blind**2)
    horizontal = EARTH_RATE * math.cos(math.radians(lat))
    for j, seconds in enumerate(TIMES):
        limit[j] = noise * math.radians(1 / 60) / (horizontal * math.sqrt(seconds) * factor)
    for r in range(runs):
        gyro, accel = feel(clean, params, 0.0003 if mode == "still" else 0.003, rng)
        state, at = north_seek.initial(), 0
        for j, seconds in enumerate(TIMES):
            end = round((seconds + LEVELLING) * RATE)
            north_seek.run(params, state, clean.stamp_ns[at:end], gyro[at:end], accel[at:end])
            at = end
            found = north_seek.solution(params, state)
            error[r, j], sigma[r, j] = wrap_pi(found.azimuth - AZIMUTH), found.sigma
            if not found.success:
                error[r, j] = np.nan
                refused[j] += 1
    return [
        summary(mode, noise, lat, seconds, float(limit[j]), error[:, j], sigma[:, j], int(refused[j]))
        for j, seconds in enumerate(TIMES)
    ]


def half_turn(noise: float, lat: float, runs: int, seed: int) -> list[str]:
    """Rows of a tool that rests, is turned half a turn in six seconds and rests again, for all times at rest."""
    params = seek_params("rotating", noise, lat)
    params = dataclasses.replace(params, mode="two_position", gyro_x_noise_deg_rth=noise, scale_x_ppm=300.0)
    rng, table = np.random.default_rng(seed), []
    blind = math.sin(INCLINATION) * math.sin(AZIMUTH)
    for seconds in TIMES:
        start = LEVELLING + 0.5 * seconds

        def roll(t: Array, start: float = start) -> Array:
            return np.asarray(0.4 + math.pi * np.clip((t - start) / 6.0, 0.0, 1.0))

        clean = motion(seconds + LEVELLING + 6.0, math.radians(lat), INCLINATION, AZIMUTH, roll, RATE)
        error, sigma, no = np.empty(runs), np.empty(runs), 0
        for r in range(runs):
            gyro, accel = feel(clean, params, 0.0003, rng)
            state = north_seek.initial()
            north_seek.run(params, state, clean.stamp_ns, gyro, accel)
            found = north_seek.solution(params, state)
            error[r], sigma[r] = wrap_pi(found.azimuth - AZIMUTH) if found.success else np.nan, found.sigma
            no += not found.success
        horizontal = EARTH_RATE * math.cos(math.radians(lat)) * math.sqrt(1.0 - blind**2)
        limit = noise * math.radians(1 / 60) / (horizontal * math.sqrt(seconds))
        table.append(summary("two positions", noise, lat, seconds, limit, error, sigma, no))
    return table


def s1(noise: float, lat: float, runs: int, seed: int) -> list[str]:
    """Rows of S1's 15-state filter on a still tool with known bias."""
    params = north_ekf.Params(
        latitude_deg=lat, gyro_noise_deg_rth=noise, gyro_bias_deg_h=noise / 50.0, accel_bias_ug=20.0
    )
    clean = motion(TIMES[-1], math.radians(lat), INCLINATION, AZIMUTH, still, RATE)
    rng = np.random.default_rng(seed)
    at = [round(seconds * RATE) - 1 for seconds in TIMES]
    error, sigma = np.empty((runs, len(TIMES))), np.empty((runs, len(TIMES)))
    for r in range(runs):
        gyro, accel = felt(
            clean, rng, noise, None, params.accel_noise_ug_rthz,
            rng.standard_normal(3) * params.gyro_bias_deg_h * DEG_H, rng.standard_normal(3) * 20e-6 * G0,
        )  # fmt: skip
        north = north_ekf.run(params, north_ekf.initial(params), clean.stamp_ns, gyro, accel)
        error[r], sigma[r] = wrap_pi(north.azimuth[at] - AZIMUTH), north.sigma_azimuth[at]
    rate = EARTH_RATE * math.cos(math.radians(lat))
    return [
        summary(
            "S1, 15 states", noise, lat, seconds, noise * math.radians(1 / 60) / (rate * math.sqrt(seconds)),
            error[:, j], sigma[:, j], 0,
        )
        for j, seconds in enumerate(TIMES)
    ]  # fmt: skip


def turning_for_hours(noise: float, lat: float, runs: int, hours: float, seed: int) -> str:
    """Row of the filter that turns for hours and does not trust the hole axis to keep still."""
    params = north_seek.Params(
        mode="continuous", latitude_deg=lat, gyro_noise_deg_rth=noise, gyro_walk_deg_h_rth=0.0, accel_bias_ug=20.0,
        axis_walk_deg_rth=0.5, block_seconds=0.4, lead_sigma_ms=0.05, expected_azimuth_deg=math.degrees(AZIMUTH) + 10.0,
    )  # fmt: skip
    clean = motion(hours * 3600.0, math.radians(lat), INCLINATION, AZIMUTH, steady(12.0), 5.0)
    rng = np.random.default_rng(seed)
    error, sigma = np.empty(runs), np.empty(runs)
    for r in range(runs):
        bias, accel_bias = draw(params, rng)
        gyro, accel = felt(clean, rng, noise, 0.42, params.accel_noise_ug_rthz, bias, accel_bias)
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, gyro, accel)
        found = north_seek.solution(params, state)
        error[r], sigma[r] = wrap_pi(found.azimuth - AZIMUTH), found.sigma
    limit = noise * math.radians(1 / 60) / math.sqrt(EARTH_RATE * math.cos(math.radians(lat)))
    return summary("continuous", noise, lat, hours * 3600.0, limit, error, sigma, 0)


def rows(runs: int = 200, progress: Callable[[str], None] | None = None) -> list[str]:
    """All Markdown rows, head and rule first."""
    table = [HEAD, RULE]
    low, high = band(runs)

    def add(more: list[str]) -> None:
        table.extend(more)
        if progress:
            for row in more:
                progress(row)

    if progress:
        progress(f"{runs} runs; 95 % band of NEES {low:.2f} to {high:.2f}")
        progress(HEAD)
        progress(RULE)
    for number, noise in enumerate(NOISES):
        for lat in LATITUDES:
            add(seek("still", noise, lat, runs, 1000 + 10 * number + round(lat)))
            add(seek("rotating", noise, lat, runs, 2000 + 100 * number + round(lat)))
            if lat in (34.0, 60.0):
                add(half_turn(noise, lat, runs, 3000 + 100 * number + round(lat)))
        add(s1(noise, 34.0, max(runs // 2, 2), 300 + number))
    for noise, lat in ((0.05, 34.0), (0.05, 60.0), (0.01, 34.0)):
        add([turning_for_hours(noise, lat, max(runs // 10, 2), 6.0, 400)])
    told = ["", verdict(table, low, high)]
    if progress:
        progress(told[-1])
    return [*table, *told]


def verdict(table: list[str], low: float, high: float) -> str:
    """Sentence on the rows of the seek: how many stay within 1.2 limits and within the 95 % band of NEES."""
    cells = [row.split("|") for row in table if row.startswith(("| still", "| rotating", "| two"))]
    far = [c for c in cells if max(float(c[8]), float(c[9])) > 1.2]
    outside = sum(not low <= float(c[10]) <= high for c in cells)
    names = "; ".join(f"{c[1].strip()} {c[2].strip()} at {c[3].strip()} deg, {c[4].strip()} s" for c in far)
    return (
        f"{len(cells) - len(far)} of {len(cells)} cells have error and sigma within 1.2 limits"
        + (f" (not: {names})" if far else "")
        + f"; NEES outside {low:.2f} to {high:.2f} in {outside}, expected by chance {0.05 * len(cells):.0f}."
    )


def main() -> None:
    """Print the table; the first argument is the number of runs."""
    rows(int(sys.argv[1]) if len(sys.argv) > 1 else 200, lambda row: print(row, flush=True))


if __name__ == "__main__":
    main()
