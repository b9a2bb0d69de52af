"""
Monte Carlo of the magnetic, gyro and fused azimuth of stations: error, sigma, NEES and verdicts, as Markdown.

Multi-station runs are of two kinds: with the small errors that the figures of the compared tool can be reproduced with,
and with every error as large as the tool code has it. Stations are drawn at attitudes with interference as expected and
unannounced. S1's field case runs from raw samples to the survey. ``nice -n 10 python tests/bench_magnetics.py [RUNS]``;
200 runs take about six minutes on one core.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mwd_estimation import fusion, magnetics, multistation
from mwd_estimation.gyro_station import GyroSettings
from mwd_estimation.north_seek import Solution
from mwd_estimation.pipeline import EstimatorSettings, Pipeline, ReferenceSettings
from mwd_estimation.reference import Reference
from mwd_estimation.sensor_errors import BENCH, SensorErrors
from mwd_estimation.station import Station, StationSettings, station
from mwd_estimation.survey import fused
from mwd_sensors import scenario
from mwd_sensors.frames import mat_nt, wrap_pi
from mwd_sensors.sonde import Sonde

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "mwd_estimation" / "test"))
from test_multistation import QUIET, drawn_run

ROOT = Path(__file__).resolve().parents[1]
Array = NDArray[np.float64]
DEG = math.radians(1.0)
REFERENCE = Reference(50e-6, 72 * DEG, 3 * DEG, 1 * DEG, 9.81, "drawn")
# Limit of a gyro of .05 deg/sqrt(h) after two minutes at 34 deg (DESIGN section 3).
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
S1_HEAD = "| case | stations | rms deg | mean deg | sigma deg | NEES | within 2 deg | magnetic off by deg |"


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
        done = multistation.analyse(f_t, b_t, reference)
        alone = magnetics.axial_correction(
            f_t, b_t, reference.horizontal, reference.vertical, errors.covariance(f_t, b_t) + noise,
            reference.covariance, plausible=3e-6,
        )  # fmt: skip
        raw.append(wrap_pi(done.azimuth_raw - azi))
        single.append(wrap_pi(alone.azimuth - azi))
        refused += bool(done.refused)
        if done.refused:
            continue
        msa.append(wrap_pi(done.azimuth - azi))
        sigma.append(done.sigma_azimuth)
        gyro = azi + np.random.default_rng(5000 + seed).normal(0.0, GYRO_SIGMA, len(azi))
        known = multistation.GyroAzimuths(gyro, np.full(len(azi), GYRO_SIGMA))
        aided.append(wrap_pi(multistation.analyse(f_t, b_t, reference, gyro=known).azimuth - azi))
        for k in range(len(azi)):
            pair = [
                fusion.Candidate("multistation", float(done.azimuth[k]), float(done.sigma_azimuth[k])),
                fusion.Candidate("gyro", float(gyro[k]), GYRO_SIGMA, family=fusion.GYRO),
            ]
            together.append(wrap_pi(fusion.fuse(pair).azimuth - azi[k]))
    figures = [rms(np.concatenate(v)) for v in (raw, single, msa, sigma)]
    name = "build 5-85 deg, 650 nT" if kind == "build" else "east-west horizontal, 900 nT"
    told = {"build": "1.63, .34, .089", "east-west": "3.21, 3.72, .290"}[kind] if small else ""
    words = [f"{v:.3f}" for v in figures]
    words += [ratio(np.concatenate(msa), np.concatenate(sigma)), str(refused)]
    words += [f"{rms(np.array(together)):.3f}", f"{rms(np.concatenate(aided)):.3f}", told]
    return f"| {name} | {'small' if small else 'tool code'} | " + " | ".join(words) + " |"


def drawn_station(inc: float, azi: float, axial: float, rng: np.random.Generator) -> Station:
    """A station with every error of the tool code drawn; degrees, and axial interference in T, one sigma."""
    mat_tn = mat_nt(inc * DEG, azi * DEG, rng.uniform(0.0, math.tau)).T
    f_t = mat_tn @ np.array([0.0, 0.0, -9.81])
    b_t = mat_tn @ np.array([REFERENCE.horizontal, 0.0, REFERENCE.vertical])
    b_t = b_t + np.array([rng.normal(0.0, axial), 0.0, 0.0])
    declination = math.sqrt(REFERENCE.declination_variance(REFERENCE.horizontal))
    told = dataclasses.replace(
        REFERENCE,
        total=50e-6 + rng.normal(0.0, REFERENCE.sigma_total),
        dip=72 * DEG + rng.normal(0.0, REFERENCE.sigma_dip),
        declination=3 * DEG + rng.normal(0.0, declination),
    )
    f_t = f_t * (1.0 + rng.normal(0.0, 0.0005, 3)) + rng.normal(0.0, 0.004, 3)
    b_t = b_t * (1.0 + rng.normal(0.0, 0.0016, 3)) + rng.normal(0.0, 70e-9, 3)
    return station(f_t, b_t, told, StationSettings(errors=BENCH))


def gyro_solution(azimuth: float, sigma: float, inclination: float) -> Solution:
    """What a seek hands over, of an azimuth from true north, rad."""
    none = (math.nan,) * 4
    return Solution(
        True, "", "still", azimuth, sigma, inclination, 0.0, 120.0, sigma, none, none, none[:3], none[:3]
    )  # fmt: skip


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
        both = fused(shot, shot, gyro).station
        found["with gyro"].append((float(wrap_pi(both.azimuth - truth)), both.sigma_azimuth))
    pairs = {name: np.array(values).reshape(-1, 2) for name, values in found.items()}
    scores = " | ".join(ratio(pair[:, 0], pair[:, 1]) for pair in pairs.values())
    accepted, doubtful = (100.0 * names.count(word) / runs for word in ("accept", "doubtful"))
    error = f"{rms(pairs['accepted'][:, 0]):.2f}" if accepted else ""
    return f"| {inc} | {azi} | {axial_nt:g} | {scores} | {accepted:.0f} | {doubtful:.0f} | {error} |"


def s1(name: str, seeds: int, gyro: dict[str, float | str], changes: dict[str, object], one_position: bool) -> str:
    """
    Row of S1's cases: a survey asked for at the end of each station's rest, from raw samples to the fused azimuth.

    gyro: settings of the estimator; changes: of the precision unit's grade; one_position: only the first rest.
    """
    error, sigma, magnetic = [], [], []
    path = ROOT / "bags" / "scenarios" / f"{name}.yaml"
    for seed in range(1, seeds + 1):
        told = scenario.read(path, {"seed": seed})
        if changes:
            told = scenario.read(path, {"seed": seed, "precision": {"grade": "tactical_north", "changes": changes}})
        place = told.place
        field = ReferenceSettings(
            source="model", lat_deg=place.latitude_deg, lon_deg=place.longitude_deg, height_m=place.height_m
        )
        pipeline = Pipeline(EstimatorSettings(reference=field, gyro=GyroSettings(**gyro)))
        rest, rests = 0, 0
        for block in Sonde(told).blocks(1.0):
            truth = block["truth"]
            moves = bool(max(np.abs(truth["angular_velocity"]).max(), np.abs(truth["velocity"]).max()) > 1e-3)
            rest = 0 if moves else rest + 1
            rests += rest == 100
            # Two rests of 150 s at a station, half a turn apart.
            if rest == 138 and rests % 2 == (1 if one_position else 0):
                pipeline.request_survey(8.0)
            pipeline.push_mag(block["imu/mag"])
            pipeline.push_precision(block["gyro/data_raw"])
            for survey in pipeline.push_imu(block["imu/data_raw"]).surveys:
                if survey.requested:
                    azimuth = float(truth["azimuth"][-1])
                    error.append(float(wrap_pi(survey.station.azimuth - azimuth)))
                    sigma.append(survey.station.sigma_azimuth)
                    raw = survey.station.by_method("raw")
                    magnetic.append(abs(float(wrap_pi(raw.azimuth - azimuth))) if raw else math.nan)
    e, s = np.array(error), np.array(sigma)
    within = float(np.mean(np.abs(e) <= 2.0 * DEG))
    return (
        f"{len(e)} | {rms(e):.2f} | {math.degrees(float(e.mean())):+.2f} | {math.degrees(float(s.mean())):.2f} | "
        f"{ratio(e, s)} | {100.0 * within:.0f} % | {math.degrees(float(np.max(magnetic))):.1f} |"
    )


def s1_rows(seeds: int) -> list[str]:
    """Rows of S1's field and laboratory case with the gyros they are told with and with a quieter one."""
    known = {"g_sensitivity_deg_h_g": 0.05}
    tactical = {
        "gyro": {
            "noise_deg_sqrt_h": 0.01, "bias_deg_h": 0.02, "instability_deg_h": 0.005, "g_deg_h_g": 0.0,
            "bias_deg_h_per_c": 0.001,
        }
    }  # fmt: skip
    told = {"g_sensitivity_deg_h_g": 0.0, "bias_deg_h": 0.02, "bias_scale": "stated", "walk_deg_h_rth": 0.1}
    cases: list[tuple[str, str, dict[str, float | str], dict[str, object], bool]] = [
        ("field, .05 deg/sqrt(h), 5 min, settings as they come", "s1_field", {}, {}, False),
        ("field, the same, g-sensitivity told", "s1_field", dict(known), {}, False),
        ("laboratory, the same", "s1_lab", dict(known), {}, False),
        ("field, .01 deg/sqrt(h), one position of 2 min, told", "s1_field", dict(told), dict(tactical), True),
        (
            "field, .01 deg/sqrt(h), one position of 2 min, settings as they come",
            "s1_field", {"g_sensitivity_deg_h_g": 0.0}, dict(tactical), True,
        ),
    ]  # fmt: skip
    return [f"| {title} | {s1(name, seeds, gyro, changes, alone)}" for title, name, gyro, changes, alone in cases]


def rows(runs: int = 200, progress: Callable[[str], None] | None = None) -> list[str]:
    """All Markdown rows of the three tables, titles and heads first."""
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
    low, high = 1.0 - 1.96 * math.sqrt(2.0 / runs), 1.0 + 1.96 * math.sqrt(2.0 / runs)
    head(f"Stations, errors of the tool code drawn; 95 % band of NEES {low:.2f} to {high:.2f}", STATION_HEAD)
    for axial_nt in (220.0, 500.0, 1500.0):
        for inc, azi in ATTITUDES:
            add(verdicts(inc, azi, axial_nt, runs))
    head("S1, from raw samples to the fused azimuth", S1_HEAD)
    add(*s1_rows(max(runs // 20, 1)))
    return table


def main() -> None:
    """Print the tables; the first argument is the number of runs."""
    rows(int(sys.argv[1]) if len(sys.argv) > 1 else 200, lambda row: print(row, flush=True))


if __name__ == "__main__":
    main()
