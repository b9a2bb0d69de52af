# SPDX-License-Identifier: Apache-2.0
"""Stamps of a host that reads late, rounds, or reads in batches cost hardly any accuracy, and no honesty."""

import functools

import numpy as np
import pytest
from tool_streams import REFERENCE, START, streams

from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.frames import mat_nt, wrap_pi

pytestmark = pytest.mark.slow(2)

INCLINATION, AZIMUTH, SECONDS = 0.8, 1.9, 40
MS = 10**6
EIGHT = "eight with one stamp"


def host(true, rng):
    """Return the stamps of a host that reads up to some milliseconds late."""
    late = np.round(np.abs(rng.normal(0.0, MS, len(true)))).astype(np.int64)
    return np.maximum.accumulate(true + late)


STAMPS = {
    "host": host,
    "rounded to 4 ms": lambda true, _: true // (4 * MS) * (4 * MS),
    "rounded to 16 ms": lambda true, _: true // (16 * MS) * (16 * MS),
    "batches of 16 ms": lambda true, _: -(-true // (16 * MS)) * (16 * MS),
    "rounded to 20 ms": lambda true, _: true // (20 * MS) * (20 * MS),
    EIGHT: lambda true, _: true[np.minimum(np.arange(len(true)) // 8 * 8 + 7, len(true) - 1)],
}


@functools.cache
def measured():
    """Return samples of a string whose speed changes, and the toolface of each."""
    rng, times = np.random.default_rng(3), 0.01 * np.arange(100 * SECONDS)
    rate = 10.0 + 3.0 * np.sin(0.4 * times)
    # A sample is the mean over the time before it.
    toolface = np.cumsum(rate) * 0.01
    mat = mat_nt(INCLINATION, np.full(len(times), AZIMUTH), toolface)
    imu, mag = streams(mat, rng, rate=rate)
    imu["linear_acceleration"] += rng.normal(0.0, 1.0, (len(times), 3))
    return imu, mag, toolface


def estimated(imu_ns, mag_ns, block=100):
    imu, mag, _ = measured()
    imu, mag = imu.copy(), mag.copy()
    imu["stamp_ns"], mag["stamp_ns"] = imu_ns, mag_ns
    pipeline, parts = Pipeline(EstimatorSettings(), REFERENCE), []
    for start in range(0, len(imu), block):
        pipeline.push_mag(mag[start : start + block])
        parts.append(pipeline.push_imu(imu[start : start + block]))
    return np.concatenate([part.attitude for part in parts]), pipeline


def errors(attitude):
    """Return the errors of inclination, toolface and azimuth in the second half, rad, each with its sigma."""
    late = slice(len(attitude) // 2, None)
    rows, truth = attitude[late], measured()[2][late]
    return [
        (wrap_pi(rows[name] - true), rows[f"sigma_{name}"])
        for name, true in (("inclination", INCLINATION), ("gravity_toolface", truth), ("azimuth", AZIMUTH))
    ]


@functools.cache
def clean():
    imu, mag, _ = measured()
    return [np.sqrt(np.mean(error**2)) for error, _ in errors(estimated(imu["stamp_ns"], mag["stamp_ns"])[0])]


# A magnetometer that is late by half a batch of eight from the first sample on, in a turning string, is taken for a
# magnetometer in other axes.
@pytest.mark.parametrize(
    ("kind", "uneven"),
    [(kind, which) for kind in STAMPS for which in ("both", "imu", "mag") if (kind, which) != (EIGHT, "mag")],
)
def test_uneven_stamps_cost_hardly_any_accuracy(kind, uneven):
    rng, (imu, mag, _) = np.random.default_rng(4), measured()
    imu_ns = STAMPS[kind](imu["stamp_ns"], rng) if uneven != "mag" else imu["stamp_ns"]
    mag_ns = STAMPS[kind](mag["stamp_ns"], rng) if uneven != "imu" else mag["stamp_ns"]
    attitude, pipeline = estimated(imu_ns, mag_ns)
    assert pipeline.counters.rejected == 0
    # The rows have the stamps of the messages.
    assert (attitude["stamp_ns"] == imu_ns).all()
    # If only one stream is uneven, the other one is late by a part of a batch: `test_magnetic_delay`.
    same_delay = uneven == "both"
    if same_delay:
        assert pipeline.sensor_faults == []
    for (error, sigma), usual in list(zip(errors(attitude), clean(), strict=True))[: 3 if same_delay else 2]:
        assert np.sqrt(np.mean(error**2)) < 1.3 * usual
        assert np.mean(np.abs(error) > 3.0 * sigma) < 0.01


@pytest.mark.parametrize("kind", STAMPS)
def test_uneven_stamps_give_the_same_bits_for_any_cut(kind):
    rng, (imu, mag, _) = np.random.default_rng(4), measured()
    imu_ns, mag_ns = STAMPS[kind](imu["stamp_ns"], rng), STAMPS[kind](mag["stamp_ns"], rng)
    whole, _ = estimated(imu_ns, mag_ns)
    for block in (7, len(imu)):
        assert estimated(imu_ns, mag_ns, block)[0].tobytes() == whole.tobytes()


def test_a_clock_that_stands_still_is_refused():
    imu, _, _ = measured()
    still = np.minimum(imu["stamp_ns"], START + 10 * 10**9)
    _, pipeline = estimated(still, still)
    assert pipeline.counters.rejected > 0.9 * (len(imu) - 1000)
    assert [fault.code.name for fault in pipeline.sensor_faults] == ["STAMPS"]
