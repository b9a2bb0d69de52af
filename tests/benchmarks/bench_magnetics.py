"""
Monte Carlo of the magnetic, gyro and fused azimuth of stations: error, sigma, NEES and verdicts, as Markdown.

Multi-station runs are of two kinds: with the small errors that the figures of the compared tool can be reproduced with,
and with every error as large as the tool code has it. Then S0's table; an east-west run with a gyro, station by station
as the estimator takes it; and stations drawn at attitudes with interference as expected and unannounced.
``nice -n 10 python tests/benchmarks/bench_magnetics.py [RUNS]``; 200 runs, as it comes, take three minutes on one core.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable

import numpy as np
from test_multi_station_analysis import QUIET, drawn_run

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.error_model import BENCH, SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.magnetic import axial_correction
from mwd_estimation.survey import azimuth_fusion, multi_station_analysis
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.gyro_evidence import gyro_for_run
from mwd_estimation.survey.run_history import Params as RunParams
from mwd_estimation.survey.run_history import StationRun
from mwd_estimation.survey.station import Station, StationSettings, station
from mwd_estimation.survey.station_azimuth import weigh
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import mat_nt, wrap_pi

DEG = math.radians(1.0)
REFERENCE = Reference(50e-6, 72 * DEG, 3 * DEG, 1 * DEG, 9.81, "drawn")
# Limit of a gyro of .05 deg/sqrt(h) after two minutes at 34 deg (docs/methods/gyrocompass.md).
GYRO_SIGMA = 1.26 * DEG
ATTITUDES = (
    (3, 40),
    (30, 45),
    (30, 90),
    (45, 70),
    (60, 20),
    (60, 90),
    (75, 60),
    (75, 90),
    (88, 30),
    (88, 60),
    (88, 90),
)
MSA_HEAD = (
    "| run of 40 stations | errors | raw | single station | multi-station | its sigma | NEES | refused "
    "| with a gyro fused | with it in the analysis | compared tool |"
)
STATION_HEAD = (
    "| inclination | azimuth | axial drawn nT | raw NEES | corrected NEES | accepted NEES | with a gyro NEES "
    "| accepted % | doubtful % | error of accepted deg |"
)
GOES_HEAD = (
    "| station | magnetic alone | its NEES | gyro alone | fused, magnetic run | its NEES | fused, run with gyro "
    "| its NEES | its sigma |"
)
S0_HEAD = "| axial interference nT | raw, S0 | raw, ours | corrected, S0 | corrected, ours | its sigma |"


def rms(values: Array) -> float:
    """Root mean square of angles in rad, in deg."""
    return math.degrees(float(np.sqrt(np.mean(np.square(values))))) if len(values) else math.nan


def ratio(error: Array, sigma: Array) -> str:
    """NEES as text."""
    return f"{np.mean((error / sigma) ** 2):.2f}" if len(error) else ""


def multi(kind: str, small: bool, runs: int) -> str:
    """Row of a kind of run: build with 650 nT, or east-west horizontal with 900 nT; angles in deg."""
    options = QUIET if small else {}
    errors = SensorErrors(0.001, 0.0001, 25.0, 0.0003) if small else SensorErrors()
    noise = np.diag([4e-6] * 3 + [4e-16] * 3)
    raw, single, msa, sigma, together, aided, refused = [], [], [], [], [], [], 0
    for seed in range(runs):
        f_t, b_t, reference, _, azi, _, _ = drawn_run(kind, seed, **options)
        done = multi_station_analysis.analyse(f_t, b_t, reference)
        alone = axial_correction.axial_correction(
            f_t,
            b_t,
            reference.horizontal,
            reference.vertical,
            errors.covariance(f_t, b_t) + noise,
            reference.covariance,
            plausible=3e-6,
        )
        raw.append(wrap_pi(done.azimuth_raw - azi))
        single.append(wrap_pi(alone.azimuth - azi))
        refused += bool(done.refused)
        if done.refused:
            continue
        msa.append(wrap_pi(done.azimuth - azi))
        sigma.append(done.sigma_azimuth)
        gyro = azi + np.random.default_rng(5000 + seed).normal(0.0, GYRO_SIGMA, len(azi))
        known = multi_station_analysis.GyroAzimuths(gyro, np.full(len(azi), GYRO_SIGMA))
        aided.append(wrap_pi(multi_station_analysis.analyse(f_t, b_t, reference, gyro=known).azimuth - azi))
        for k in range(len(azi)):
            pair = [
                azimuth_fusion.Candidate(
                    AzimuthMethod.MULTI_STATION, float(done.azimuth[k]), float(done.sigma_azimuth[k])
                ),
                azimuth_fusion.Candidate(AzimuthMethod.GYRO, float(gyro[k]), GYRO_SIGMA, family=azimuth_fusion.GYRO),
            ]
            together.append(wrap_pi(azimuth_fusion.fuse(pair).azimuth - azi[k]))
    figures = [rms(np.concatenate(v)) for v in (raw, single, msa, sigma)]
    name = "build 5-85 deg, 650 nT" if kind == "build" else "east-west horizontal, 900 nT"
    given = {"build": "1.63, .34, .089", "east-west": "3.21, 3.72, .290"}[kind] if small else ""
    words = [f"{v:.3f}" for v in figures]
    words += [ratio(np.concatenate(msa), np.concatenate(sigma)), str(refused)]
    words += [f"{rms(np.array(together)):.3f}", f"{rms(np.concatenate(aided)):.3f}", given]
    return f"| {name} | {'small' if small else 'tool code'} | " + " | ".join(words) + " |"


def drawn_station(inc: float, azi: float, axial: float, rng: np.random.Generator) -> Station:
    """A station with every error of the tool code drawn; degrees, and axial interference in T, one sigma."""
    mat_tn = mat_nt(inc * DEG, azi * DEG, rng.uniform(0.0, math.tau)).T
    f_t = mat_tn @ np.array([0.0, 0.0, -9.81])
    b_t = mat_tn @ np.array([REFERENCE.horizontal, 0.0, REFERENCE.vertical])
    b_t = b_t + np.array([rng.normal(0.0, axial), 0.0, 0.0])
    declination = math.sqrt(REFERENCE.declination_variance(REFERENCE.horizontal))
    given = dataclasses.replace(
        REFERENCE,
        total=50e-6 + rng.normal(0.0, REFERENCE.sigma_total),
        dip=72 * DEG + rng.normal(0.0, REFERENCE.sigma_dip),
        declination=3 * DEG + rng.normal(0.0, declination),
    )
    f_t = f_t * (1.0 + rng.normal(0.0, 0.0005, 3)) + rng.normal(0.0, 0.004, 3)
    b_t = b_t * (1.0 + rng.normal(0.0, 0.0016, 3)) + rng.normal(0.0, 70e-9, 3)
    return station(f_t, b_t, given, StationSettings(errors=BENCH))


def gyro_solution(azimuth: float, sigma: float, inclination: float) -> Solution:
    """What a seek hands over, of an azimuth from true north, rad."""
    return Solution(None, "still", azimuth, sigma, inclination, 0.0, 120.0, sigma)


def verdicts(inc: float, azi: float, axial_nt: float, runs: int) -> str:
    """Row of an attitude and an interference: NEES of every azimuth published, and the verdict."""
    rng = np.random.default_rng(round(1000 * inc + azi + axial_nt))
    truth = (azi + 2.0) * DEG
    found: dict[str, list[tuple[float, float]]] = {"raw": [], "corrected": [], "accepted": [], "with gyro": []}
    names = []
    for _ in range(runs):
        shot = drawn_station(inc, azi, axial_nt * 1e-9, rng)
        names.append(shot.verdict)
        for one in shot.azimuths:
            if not one.refused:
                found[one.method].append((float(wrap_pi(one.azimuth - truth)), one.sigma))
        if shot.verdict == "accept":
            found["accepted"].append((float(wrap_pi(shot.azimuth - truth)), shot.sigma_azimuth))
        true_azimuth = truth + 1.0 * DEG
        gyro = gyro_solution(true_azimuth + rng.normal(0.0, GYRO_SIGMA), GYRO_SIGMA, inc * DEG)
        both = weigh(shot, shot, gyro).station
        found["with gyro"].append((float(wrap_pi(both.azimuth - truth)), both.sigma_azimuth))
    pairs = {name: np.array(values).reshape(-1, 2) for name, values in found.items()}
    scores = " | ".join(ratio(pair[:, 0], pair[:, 1]) for pair in pairs.values())
    accepted, doubtful = (100.0 * names.count(word) / runs for word in ("accept", "doubtful"))
    error = f"{rms(pairs['accepted'][:, 0]):.2f}" if accepted else ""
    return f"| {inc} | {azi} | {axial_nt:g} | {scores} | {accepted:.0f} | {doubtful:.0f} | {error} |"


def s0_rows() -> list[str]:
    """Rows of S0's table 1: 40 uT, dip 12 deg, the tool at 67 deg inclination and 42 deg from magnetic north."""
    total, dip = 4e-5, 12.0 * DEG
    mat_tn = mat_nt(67.0 * DEG, 42.0 * DEG, 112.0 * DEG).T
    f_t = mat_tn @ np.array([0.0, 0.0, -9.81])
    reference = Reference(total, dip, 0.0, 0.0, 9.81, "S0")
    table = []
    for axial_nt, paper in ((20000.0, 28.87), (40000.0, 21.67), (80000.0, 14.30)):
        b_t = mat_tn @ np.array([total * math.cos(dip), 0.0, total * math.sin(dip)]) + [axial_nt * 1e-9, 0.0, 0.0]
        done = axial_correction.axial_correction(
            f_t,
            b_t,
            reference.horizontal,
            reference.vertical,
            SensorErrors().covariance(f_t, b_t),
            reference.covariance,
        )
        table.append(
            f"| {axial_nt:g} | {paper:.2f} | {math.degrees(float(magnetic_geometry.raw_azimuth(f_t, b_t))):.2f} "
            "| 42.00 | "
            f"{math.degrees(float(done.azimuth)):.2f} | {math.degrees(float(done.sigma_azimuth)):.2f} |"
        )
    return table


def as_it_goes(runs: int) -> list[str]:
    """
    Rows of an east-west run of twelve stations, errors of tool-code size, a gyro azimuth at each.

    The gyro errs by 1.26 deg at each station anew and .3 deg at all alike. Fused with a run that knows no gyro, and
    with one that the gyro of the stations before has taught.
    """
    n, common = 12, 0.3 * DEG
    sigma = math.hypot(GYRO_SIGMA, common)
    settings = StationSettings(errors=BENCH)
    columns = ("magnetic", "gyro", "plain", "taught")
    found: dict[str, list[list[tuple[float, float]]]] = {name: [[] for _ in range(n)] for name in columns}
    for seed in range(runs):
        f_t, b_t, reference, inc, azi, _, _ = drawn_run("east-west", seed, n=n)
        rng = np.random.default_rng(9000 + seed)
        reference = dataclasses.replace(reference, declination=0.0, convergence=0.0)
        declination = math.sqrt(reference.declination_variance(reference.horizontal))
        truth = azi + rng.normal(0.0, declination)
        seen = truth + rng.normal(0.0, GYRO_SIGMA, n) + rng.normal(0.0, common)
        plain, taught = StationRun(RunParams()), StationRun(RunParams())
        for k in range(n):
            alone = station(f_t[k], b_t[k], reference, settings)
            gyro = dataclasses.replace(gyro_solution(float(seen[k]), sigma, float(inc[k])), limit=GYRO_SIGMA)
            together, _ = plain.take(alone, settings)
            both = weigh(alone, together, gyro).station
            magnetic = weigh(alone, together, None).station
            wise, analysis = taught.take(alone, settings)
            aided = 0.0 if analysis is None else float(analysis.by_gyro[-1])
            knowing = weigh(alone, wise, gyro, aided=aided)
            if knowing.alarm == ():
                taught.add_gyro(*gyro_for_run(knowing.station, gyro))
            for name, one in (("magnetic", magnetic), ("plain", both), ("taught", knowing.station)):
                found[name][k].append((float(wrap_pi(one.azimuth - truth[k])), one.sigma_azimuth))
            found["gyro"][k].append((float(seen[k] - truth[k]), sigma))
    table = []
    for k in (0, 3, 4, 7, 11):
        e = {name: np.array(found[name][k]) for name in columns}
        words = [f"{rms(e['magnetic'][:, 0]):.2f}", ratio(*e["magnetic"].T), f"{rms(e['gyro'][:, 0]):.2f}"]
        for name in ("plain", "taught"):
            words += [f"{rms(e[name][:, 0]):.2f}", ratio(*e[name].T)]
        table.append(f"| {k + 1} | " + " | ".join([*words, f"{math.degrees(e['taught'][:, 1].mean()):.2f}"]) + " |")
    return table


def rows(runs: int = 200, progress: Callable[[str], None] | None = None) -> list[str]:
    """All Markdown rows of the tables, titles and heads first."""
    table: list[str] = []

    def add(*more: str) -> None:
        table.extend(more)
        if progress:
            for row in more:
                progress(row)

    def head(title: str, names: str) -> None:
        add("", f"### {title}", "", names, "|" + "---|" * (names.count("|") - 1))

    head("Multi-station analysis, azimuth error rms in deg", MSA_HEAD)
    for small in (True, False):
        for kind in ("build", "east-west"):
            add(multi(kind, small, max(runs // 4, 2)))
    head("S0, table 1: azimuth by one station, deg", S0_HEAD)
    add(*s0_rows())
    head(f"Horizontal, east-west, 900 nT, a gyro at each station, {max(runs // 4, 2)} runs; rms in deg", GOES_HEAD)
    add(*as_it_goes(max(runs // 4, 2)))
    low, high = 1.0 - 1.96 * math.sqrt(2.0 / runs), 1.0 + 1.96 * math.sqrt(2.0 / runs)
    head(f"Stations, errors of the tool code drawn; 95 % band of NEES {low:.2f} to {high:.2f}", STATION_HEAD)
    for axial_nt in (220.0, 500.0, 1500.0):
        for inc, azi in ATTITUDES:
            add(verdicts(inc, azi, axial_nt, runs))
    return table


def main() -> None:
    """Print the tables; the first argument is the number of runs."""
    rows(int(sys.argv[1]) if len(sys.argv) > 1 else 200, lambda row: print(row, flush=True))


if __name__ == "__main__":
    main()
