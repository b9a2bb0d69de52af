# SPDX-License-Identifier: Apache-2.0
"""
Errors and sigmas of north seeking against the bounds of the gyro noise: Monte Carlo cells of `bench_north`.

Bounds: N / (We cos(latitude) sqrt(T)) for a still tool with known bias, the same over sqrt(1 - sin^2 I sin^2 azimuth)
for one that rests in two positions or turns about its axis. T counts from the end of levelling (3 s) and not while the
tool is turned over. Every error that the parameters state is drawn: biases, leakage, lag, lead, scale. A run that is
refused gives no azimuth and counts as refused only.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from north_signals import Motion, measured, motion, steady, still
from numpy.typing import NDArray

from mwd_estimation.gyrocompass import north_seek, static_ekf
from mwd_estimation.gyrocompass.seek_state import SeekParams
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G
from mwd_sensors.core.frames import wrap_pi

TIMES = (60.0, 120.0, 300.0)
INCLINATION, AZIMUTH = math.radians(60.0), math.radians(40.0)
LEVELLING, RATE = 3.2, 50.0
HEAD = "| tool | N deg/rt h | latitude | " + " | ".join(f"{seconds:g} s" for seconds in TIMES) + " | refused |"


@dataclasses.dataclass(frozen=True)
class Cell:
    """A case's answers: azimuth errors and sigmas of the runs, rad, nan where refused, and its limit."""

    method: str
    noise: float
    latitude: float
    seconds: float
    limit: float
    error: Array
    sigma: Array

    @property
    def answered(self) -> NDArray[np.bool_]:
        """Which runs were answered."""
        return np.isfinite(self.error)

    @property
    def shares(self) -> tuple[float, float, float]:
        """Error (rms) and mean sigma over the limit, and NEES."""
        error, sigma = self.error[self.answered], self.sigma[self.answered]
        if not len(error):
            return math.nan, math.nan, math.nan
        return (
            float(np.sqrt(np.mean(error**2))) / self.limit,
            float(np.mean(sigma)) / self.limit,
            float(np.mean((error / sigma) ** 2)),
        )

    @property
    def summary(self) -> str:
        """Limit, deg, and the three shares."""
        return f"{math.degrees(self.limit):.3g}: " + ", ".join(f"{share:.2f}" for share in self.shares)


def table_row(cells: list[Cell]) -> str:
    """Row of a tool, a noise and a latitude, one cell for each time."""
    one = cells[0]
    refused = sum(int((~cell.answered).sum()) for cell in cells)
    return (
        f"| {one.method} | {one.noise:g} | {one.latitude:g} | "
        + " | ".join(cell.summary for cell in cells)
        + f" | {refused} |"
    )


def band(runs: int) -> tuple[float, float]:
    """95 % band of the mean of `runs` squared normal numbers (normal approximation)."""
    half = 1.96 * math.sqrt(2.0 / runs)
    return 1.0 - half, 1.0 + half


def seek_params(mode: str, noise: float, lat: float) -> SeekParams:
    """
    Parameters of a precision unit: still, its x gyro counts and its bias is known; turning, x is an MTi-class gyro.

    Alignment goes with the noise: 300 urad in a tactical unit, 20 urad in a navigation grade one.
    """
    quiet = mode == "still"
    return SeekParams(
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


def with_errors(clean: Motion, params: SeekParams, scale: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Rates and forces with every error of the parameters drawn; scale: of the x gyro, one sigma."""
    x_rate = clean.gyro_t[:, 0]
    lag, lead = rng.standard_normal(2) * [params.lag_sigma_ms * 1e-3, params.lead_sigma_ms * 1e-3]
    late = dataclasses.replace(
        clean, gyro_t=turned(clean.gyro_t, -x_rate * lag), accel_t=turned(clean.accel_t, x_rate * lead)
    )
    bias, accel_bias = draw(params, rng)
    return measured(
        late,
        rng,
        params.gyro_noise_deg_rth,
        params.gyro_x_noise_deg_rth,
        params.accel_noise_ug_rthz,
        bias,
        accel_bias,
        scale_x=scale * rng.standard_normal(),
        leak=params.leak_urad * 1e-6 * rng.standard_normal(2),
    )


def draw(params: SeekParams, rng: np.random.Generator) -> tuple[Array, Array]:
    """Gyro bias, rad/s, and force bias, m/s^2, drawn from the parameters' own sigmas."""
    gyro = np.array([params.gyro_x_bias_deg_h, params.gyro_bias_deg_h, params.gyro_bias_deg_h])
    return rng.standard_normal(3) * gyro * DEG_PER_HOUR, rng.standard_normal(3) * params.accel_bias_ug * MICRO_G


def seek(mode: str, noise: float, lat: float, runs: int, seed: int) -> list[Cell]:
    """Cells of one mode, noise and latitude for all times."""
    params = seek_params(mode, noise, lat)
    roll = still if mode == "still" else steady(60.0)
    clean = motion(TIMES[-1] + LEVELLING, math.radians(lat), INCLINATION, AZIMUTH, roll, RATE)
    rng = np.random.default_rng(seed)
    error, sigma = np.empty((runs, len(TIMES))), np.empty((runs, len(TIMES)))
    limit = np.zeros(len(TIMES))
    blind = math.sin(INCLINATION) * math.sin(AZIMUTH)
    factor = 1.0 if mode == "still" else math.sqrt(1.0 - blind**2)
    horizontal = EARTH_RATE * math.cos(math.radians(lat))
    for j, seconds in enumerate(TIMES):
        limit[j] = noise * DEG_PER_ROOT_HOUR / (horizontal * math.sqrt(seconds) * factor)
    for r in range(runs):
        gyro, accel = with_errors(clean, params, 0.0003 if mode == "still" else 0.003, rng)
        state, at = north_seek.initial(), 0
        for j, seconds in enumerate(TIMES):
            end = round((seconds + LEVELLING) * RATE)
            north_seek.run(params, state, clean.stamp_ns[at:end], gyro[at:end], accel[at:end])
            at = end
            found = north_seek.solution(params, state)
            error[r, j], sigma[r, j] = wrap_pi(found.azimuth - AZIMUTH), found.sigma
            if not found.success:
                error[r, j] = np.nan
    return [
        Cell(mode, noise, lat, seconds, float(limit[j]), error[:, j], sigma[:, j]) for j, seconds in enumerate(TIMES)
    ]


def half_turn(noise: float, lat: float, runs: int, seed: int) -> list[Cell]:
    """Cells of a tool that rests, is turned half a turn in six seconds and rests again, for all times at rest."""
    params = seek_params("rotating", noise, lat)
    params = dataclasses.replace(params, mode="two_position", gyro_x_noise_deg_rth=noise, scale_x_ppm=300.0)
    rng, table = np.random.default_rng(seed), []
    blind = math.sin(INCLINATION) * math.sin(AZIMUTH)
    for seconds in TIMES:
        start = LEVELLING + 0.5 * seconds

        def roll(t: Array, start: float = start) -> Array:
            return np.asarray(0.4 + math.pi * np.clip((t - start) / 6.0, 0.0, 1.0))

        clean = motion(seconds + LEVELLING + 6.0, math.radians(lat), INCLINATION, AZIMUTH, roll, RATE)
        error, sigma = np.empty(runs), np.empty(runs)
        for r in range(runs):
            gyro, accel = with_errors(clean, params, 0.0003, rng)
            state = north_seek.initial()
            north_seek.run(params, state, clean.stamp_ns, gyro, accel)
            found = north_seek.solution(params, state)
            error[r], sigma[r] = wrap_pi(found.azimuth - AZIMUTH) if found.success else np.nan, found.sigma
        horizontal = EARTH_RATE * math.cos(math.radians(lat)) * math.sqrt(1.0 - blind**2)
        limit = noise * DEG_PER_ROOT_HOUR / (horizontal * math.sqrt(seconds))
        table.append(Cell("two positions", noise, lat, seconds, limit, error, sigma))
    return table


def s1_filter(noise: float, lat: float, runs: int, seed: int) -> list[Cell]:
    """Cells of S1's 15-state filter on a still tool with known bias."""
    # Of the shortest seek the first half is the coarse alignment.
    params = SeekParams(
        latitude_deg=lat,
        gyro_noise_deg_rth=noise,
        gyro_bias_deg_h=noise / 50.0,
        gyro_walk_deg_h_rth=0.0,
        accel_bias_ug=20.0,
        shortest=40.0,
    )
    clean = motion(TIMES[-1], math.radians(lat), INCLINATION, AZIMUTH, still, RATE)
    rng = np.random.default_rng(seed)
    ends = [round(seconds * RATE) for seconds in TIMES]
    error, sigma = np.empty((runs, len(TIMES))), np.empty((runs, len(TIMES)))
    for r in range(runs):
        gyro, accel = measured(
            clean,
            rng,
            noise,
            None,
            params.accel_noise_ug_rthz,
            rng.standard_normal(3) * params.gyro_bias_deg_h * DEG_PER_HOUR,
            rng.standard_normal(3) * 20 * MICRO_G,
        )
        state = static_ekf.initial()
        for j, (start, end) in enumerate(itertools.pairwise([0, *ends])):
            static_ekf.run(params, state, clean.stamp_ns[start:end], gyro[start:end], accel[start:end])
            north = static_ekf.north(state)
            error[r, j], sigma[r, j] = wrap_pi(north.azimuth - AZIMUTH), north.sigma
    rate = EARTH_RATE * math.cos(math.radians(lat))
    limits = [noise * DEG_PER_ROOT_HOUR / (rate * math.sqrt(seconds)) for seconds in TIMES]
    return [
        Cell("S1, 15 states", noise, lat, seconds, limits[j], error[:, j], sigma[:, j])
        for j, seconds in enumerate(TIMES)
    ]


def conclusion(cells: list[Cell], runs: int, low: float, high: float) -> str:
    """Sentence on the cells: all together, and how many are outside of what chance allows."""
    shares = np.array([cell.shares for cell in cells])
    error, sigma, nees = np.sqrt(np.nanmean(shares[:, 0] ** 2)), np.nanmean(shares[:, 1]), np.nanmean(shares[:, 2])
    wide = int((shares[:, 1] > 1.2).sum())
    # The rms of a few runs is off by chance: allowed are 1.2 times the limit and two of the rms's own sigma.
    wrong = int((shares[:, 0] > 1.2 * (1.0 + 1.96 / math.sqrt(2.0 * runs))).sum())
    outside = int(((shares[:, 2] < low) | (shares[:, 2] > high)).sum())
    return (
        f"{len(cells)} cells of {runs} runs: error {error:.2f} and sigma {sigma:.2f} limits, NEES {nees:.2f} in the "
        f"mean; sigma beyond 1.2 limits in {wide}, error beyond 1.2 limits and chance in {wrong}; NEES outside "
        f"{low:.2f} to {high:.2f} in {outside}, by chance {0.05 * len(cells):.0f}."
    )
