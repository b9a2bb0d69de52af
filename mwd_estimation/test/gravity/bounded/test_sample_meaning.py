# SPDX-License-Identifier: Apache-2.0
"""Points that are stated as integrated samples: found from the data, at the same sample however the stream is cut."""

import dataclasses
import functools

import numpy as np
import pytest
from gravity_runs import sensed
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.track import Track
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded import sample_meaning
from mwd_estimation.gravity.smoother import Smoother
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import wire

STATED = {
    "integrated": bounded.BoundedParams(),
    "means": bounded.BoundedParams(coning=1.0),
    "points": bounded.BoundedParams(coning=1.0, sampled=True),
}


@functools.cache
def stick_slip(
    output: str = "sampled", rate_hz: int = 100, inclination_deg: float = 60.0, seed: int = 5
) -> tuple[np.ndarray, np.ndarray]:
    """Samples, dtype of `wire.IMU`, and true down of 60 s of stick-slip between 0 and 180 r/min."""
    return sensed(
        "stickslip",
        seed=seed,
        rate_hz=rate_hz,
        well={"stations": [[0.0, inclination_deg, 60.0]]},
        schedule=[{"kind": "drill", "seconds": 60.0, "rpm": 90.0, "rop_m_h": 0.0}],
        vibration={
            "random": [{"band_hz": [8.0, 300.0], "acceleration_mps2": [1.0] * 3}],
            "stick_slip": {"frequency_hz": 0.2, "depth": 1.0},
        },
        ahrs={"output": output},
    )


def followed(params: bounded.BoundedParams, imu: np.ndarray, cuts: list[int]) -> tuple[bounded.BoundedState, Track]:
    state = bounded.initial(params)
    parts = [
        bounded.run(params, state, part["stamp_ns"], part["angular_velocity"], part["linear_acceleration"])
        for part in np.split(imu, cuts)
    ]
    return state, Track._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


def toolface(down: np.ndarray) -> np.ndarray:
    return np.arctan2(-down[:, 1], -down[:, 2])


@pytest.mark.slow
@pytest.mark.parametrize("output", ["integrated", "sampled"])
@pytest.mark.parametrize(("rate_hz", "inclination_deg", "seed"), [(100, 60.0, 5), (50, 20.0, 6), (200, 85.0, 7)])
def test_points_stated_as_integrated_are_found_when_the_speed_changes(output, rate_hz, inclination_deg, seed):
    imu, down = stick_slip(output, rate_hz, inclination_deg, seed)
    state, track = followed(STATED["integrated"], imu, [])
    assert state.samples_are == {"integrated": "", "sampled": "points"}[output]
    late = len(imu) // 2
    error = np.remainder(toolface(track.g_t) - toolface(down) + np.pi, 2.0 * np.pi) - np.pi
    assert np.mean(np.abs(error[late:]) > 4.0 * track.sigma_toolface[late:]) < 0.02


@pytest.mark.parametrize("stated", ["means", "points"])
def test_a_statement_of_points_or_means_is_kept(stated):
    imu, _ = stick_slip()
    assert followed(STATED[stated], imu, [])[0].samples_are == ""


@functools.cache
def in_one_piece() -> tuple[np.ndarray, Track]:
    imu, _ = stick_slip()
    return imu, followed(STATED["integrated"], imu, [])[1]


@given(st.lists(st.integers(0, 6000), max_size=5).map(sorted))
def test_the_meaning_is_found_at_the_same_sample_however_the_stream_is_cut(cuts):
    imu, whole = in_one_piece()
    state, track = followed(STATED["integrated"], imu, cuts)
    assert state.samples_are == "points"
    assert all(np.array_equal(a, b) for a, b in zip(track, whole, strict=True))


def test_a_constant_speed_and_rest_contradict_no_statement():
    for params in STATED.values():
        for kind in ({"kind": "drill", "rpm": 90.0, "rop_m_h": 0.0}, {"kind": "still"}):
            motion = {"schedule": [{"seconds": 30.0, **kind}], "vibration": {"stick_slip": None}}
            imu, _ = sensed("stickslip", **motion, ahrs={"output": "sampled"})
            assert followed(params, imu, [])[0].samples_are == ""


def test_a_restart_of_the_estimate_and_the_smoother_keep_the_meaning():
    imu, _ = stick_slip()
    smoother = Smoother(STATED["integrated"])
    smoother.push(imu["stamp_ns"], imu["angular_velocity"], imu["linear_acceleration"])
    assert smoother.samples_are == smoother.continued().samples_are == "points"


def test_the_pipeline_says_what_it_found():
    imu, _ = stick_slip()
    samples = np.zeros(len(imu), wire.IMU.dtype)
    for name in ("stamp_ns", "angular_velocity", "linear_acceleration"):
        samples[name] = imu[name]
    for stated, said in (("integrated", True), ("points", False)):
        settings = EstimatorSettings()
        settings = dataclasses.replace(settings, tool=dataclasses.replace(settings.tool, samples=stated))
        pipeline = Pipeline(settings)
        assert sample_meaning.in_words(pipeline.samples_are) == ""
        pipeline.push_imu(samples)
        assert ("tool.samples: points" in sample_meaning.in_words(pipeline.samples_are)) == said
