# SPDX-License-Identifier: Apache-2.0
"""The estimator as a whole: same bits for any cut, honest labels, surveys against the simulated truth."""

import functools
import gc
import itertools
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.core.reason_text import text, texts
from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.core.status import Status
from mwd_estimation.core.time_jumps import MOST_AHEAD
from mwd_estimation.core.track import Track
from mwd_estimation.gravity import methods as gravity
from mwd_estimation.pipeline import estimate
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey import decision
from mwd_estimation.survey.survey_settings import SurveySettings
from mwd_sensors.core import input_covariance, wire
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_sensors.core.mount import resolve
from mwd_sensors.core.settings import changed

START = 1_700_000_000 * 10**9
REFERENCE = Reference(total=5e-5, dip=1.1, declination=0.05, convergence=0.01, gravity=9.81, source="test")


def _samples(seconds=16.0, inclination=0.8, azimuth=1.9, axial=2e-6, rate=0.0, seed=1, still_after=0.0):
    """A tool at one attitude with magnetised string; turns until `still_after`, s."""
    rng = np.random.default_rng(seed)
    n = int(seconds * 100)
    times = np.arange(n) * 0.01
    turning = np.where(times < still_after, rate, 0.0)
    mat = mat_nt(inclination, np.full(n, azimuth), np.cumsum(turning) * 0.01)
    field_n = 5e-5 * np.array([np.cos(1.1) * np.cos(0.05), np.cos(1.1) * np.sin(0.05), np.sin(1.1)])
    imu, mag = wire.IMU.empty(n), wire.MAG.empty(n)
    imu["stamp_ns"] = mag["stamp_ns"] = START + np.round(times * 1e9).astype(np.int64)
    imu["angular_velocity"] = 1e-3 * rng.normal(size=(n, 3))
    imu["angular_velocity"][:, 0] += turning
    imu["linear_acceleration"] = np.einsum("kji,j->ki", mat, [0, 0, -9.81]) + 5e-3 * rng.normal(size=(n, 3))
    mag["magnetic_field"] = np.einsum("kji,j->ki", mat, field_n) + [axial, 0, 0] + 5e-8 * rng.normal(size=(n, 3))
    return imu, mag


def _run(imu, mag, pipeline, cuts=()):
    outputs = []
    for block in np.split(np.arange(len(imu)), sorted(cuts)):
        pipeline.push_mag(mag[block])
        outputs.append(pipeline.push_imu(imu[block]))
    return outputs


def _joined(outputs, name):
    return np.concatenate([getattr(output, name) for output in outputs])


@functools.cache
def _in_one_piece():
    """Samples of a string that turns and stands still, and the outputs for one block of them."""
    imu, mag = _samples(rate=10.0, still_after=3.0)
    return imu, mag, _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE))


@pytest.mark.slow(0.9)
@settings(max_examples=8)
@given(cuts=st.lists(st.integers(0, 1600), max_size=8))
def test_any_cut_into_blocks_gives_the_same_bits(cuts):
    imu, mag, whole = _in_one_piece()
    pieces = _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE), cuts)
    for name in ("attitude", "gravity", "interference", "dynamics"):
        assert _joined(pieces, name).tobytes() == _joined(whole, name).tobytes()
    surveys = [survey for output in pieces for survey in output.surveys]
    assert [s.uuid for s in surveys] == [s.uuid for output in whole for s in output.surveys]
    assert len(surveys) == 1


def _stating(imu, mag, *, every=1, mag_from=0):
    """The same with covariances that state much noise; every: of the samples that are there; mag_from: its first."""
    for samples, vector, sigma in ((imu, "linear_acceleration", 1.0), (mag, "magnetic_field", 2e-5)):
        samples[f"{vector}_covariance"] = np.diag([sigma**2] * 3).ravel()
    return imu[::every], mag[mag_from:][::every]


@pytest.mark.slow(0.5)
@settings(max_examples=5, deadline=None)
@given(
    cuts=st.lists(st.integers(0, 1600), max_size=8),
    every=st.sampled_from([1, 10, 20]),
    mag_from=st.sampled_from([0, 30, 700]),
)
@pytest.mark.parametrize("late_ns", [0, 20_000_000])
def test_stated_noise_counts_from_a_stamp_and_not_from_the_block_in_which_it_became_known(
    late_ns, cuts, every, mag_from
):
    imu, mag = _stating(*_samples(), every=every, mag_from=mag_from)

    def run(cuts):
        pipeline, outputs, given = Pipeline(EstimatorSettings(), REFERENCE), [], 0
        for block in np.split(imu, sorted({cut // every for cut in cuts})):
            # Magnetic samples are there within the delay of the tool, and never before they are taken.
            newest = block["stamp_ns"][-1] - late_ns if len(block) else 0
            until = max(given, int(np.searchsorted(mag["stamp_ns"], newest, side="right")))
            pipeline.push_mag(mag[given:until])
            outputs.append(pipeline.push_imu(block))
            given = until
        return pipeline, outputs

    (pipeline, pieces), (one, whole) = run(cuts), run(())
    for name in ("attitude", "gravity", "interference", "dynamics"):
        assert _joined(pieces, name).tobytes() == _joined(whole, name).tobytes()
    surveys = [[survey.uuid for output in outputs for survey in output.surveys] for outputs in (pieces, whole)]
    assert surveys[0] == surveys[1]
    assert len(pipeline.noise_notes) == 2
    assert (pipeline.counters.imu, pipeline.counters.mag) == (one.counters.imu, one.counters.mag)
    assert pipeline.counters.late_mag == pipeline.counters.rejected == 0


@pytest.mark.parametrize("every", [1, 10])
def test_an_estimate_is_that_of_noise_known_from_the_first_sample_once_the_noise_is_known(every):
    imu, mag = _stating(*_samples(), every=every)
    learnt = Pipeline(EstimatorSettings(), REFERENCE)
    rows = _joined(_run(imu, mag, learnt, range(1, len(imu), 7)), "attitude")
    watch = input_covariance.NoiseWatch()
    watch.take(imu, wire.IMU.type_name)
    watch.take(mag, wire.MAG.type_name)
    known = Pipeline(EstimatorSettings(), REFERENCE, noise=watch.noise)
    assert known.noise_notes == learnt.noise_notes
    later = slice(32, None)
    assert rows[later].tobytes() == _joined(_run(imu, mag, known), "attitude")[later].tobytes()


def test_a_survey_asked_for_before_the_noise_is_known_is_refused_with_the_reason_and_not_forgotten():
    imu, mag = _stating(*_samples(seconds=6.0), every=10)
    pipeline = Pipeline(EstimatorSettings(), REFERENCE)
    first = _run(imu[:5], mag[:5], pipeline)
    pipeline.request_survey(2.0)
    outputs = first + _run(imu[5:], mag[5:], pipeline)
    (refusal,) = [refusal for output in outputs for refusal in output.refusals]
    assert refusal.reason.code is ReasonCode.NOISE_STATED


def test_one_sample_at_a_time_is_the_same_too():
    imu, mag = _samples(seconds=3.0, rate=5.0, still_after=3.0)
    whole = _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE))
    singles = _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE), range(1, 300))
    assert _joined(singles, "attitude").tobytes() == _joined(whole, "attitude").tobytes()


def test_a_still_interval_gives_a_survey_corrected_for_the_string():
    imu, mag = _samples()
    outputs = _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE))
    (survey,) = outputs[0].surveys
    station = survey.station
    assert station.verdicts.inclination == "accept"
    assert station.north == "grid"
    assert station.corrected
    assert max(station.hypotheses, key=lambda one: one[1])[0] == "axial"
    assert station.inclination == pytest.approx(0.8, abs=2e-4)
    assert abs(wrap_pi(station.azimuth - (1.9 - 0.01))) < station.sigma_azimuth
    corrected = station.by_method("corrected")
    assert wrap_pi(corrected.azimuth - (1.9 - 0.01)) == pytest.approx(0.0, abs=3e-3)
    assert station.interference == pytest.approx(2e-6, abs=3 * station.sigma_interference)
    raw = next(one for one in station.azimuths if one.method == "raw")
    assert abs(wrap_pi(raw.azimuth - 1.89)) > 0.03


def test_the_tool_s_own_field_is_learnt_while_drilling_and_taken_off_the_azimuth_with_a_truthful_sigma():
    imu, mag = _samples(seconds=60.0, rate=3.0, still_after=60.0)
    (output,) = _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE))
    attitude, own = output.attitude, output.interference
    assert not output.surveys
    late = attitude["stamp_ns"] > START + 30 * 10**9
    assert (attitude["status"][late] & Status.CORRECTED > 0).all()
    assert not (attitude["status"][100:] & Status.MAG_DISTURBED).any()
    error = np.abs(wrap_pi(attitude["azimuth"][100:] - 1.89))
    assert error[3000:].max() < 0.01
    assert (error < 3.0 * attitude["sigma_azimuth"][100:]).all()
    assert (np.abs(own["axial"] - 2e-6)[20:] < 3.0 * own["sigma_axial"][20:]).all()
    assert own["sigma_axial"][-1] < 0.5e-6
    assert (np.abs(own["cross_axial"][-1]) < 3.0 * own["sigma_cross_axial"][-1]).all()


@pytest.mark.slow(0.6)
@pytest.mark.fault_case(6)
@pytest.mark.parametrize("reading", [34.9, -34.9, 5.0, np.nan])
@pytest.mark.parametrize("axis", [0, 1])
def test_an_azimuth_without_gyros_keeps_what_was_learnt_of_the_string_and_its_sigma_covers_the_error(axis, reading):
    """A gyro stops at its limit, at a value or altogether, at rest, after the string has turned."""
    for seed, axial in ((3311, 2e-6), (3312, -1.5e-6)):
        imu, mag = _samples(seconds=40.0, axial=axial, rate=10.0, still_after=15.0, seed=seed)
        imu["angular_velocity"][2000:, axis] = reading
        rows = _joined(_run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE), range(50, 4000, 50)), "attitude")
        # The gyro is named within two seconds, and gravity is known again within another two.
        rows = rows[2400:]
        known = np.isfinite(rows["azimuth"])
        assert known.mean() > 0.95
        error, sigma = np.abs(wrap_pi(rows["azimuth"] - 1.9))[known], rows["sigma_azimuth"][known]
        assert np.mean(error > 3.0 * sigma) < 0.01
        assert np.median(sigma) < np.radians(2.0)
        assert (rows["status"][known] & int(Status.CORRECTED) != 0).mean() > 0.95


@pytest.mark.fault_case(24)
def test_a_passing_casing_is_flagged_and_the_azimuth_carried_through_it():
    imu, mag = _samples(seconds=60.0, rate=3.0, still_after=60.0)
    mag["magnetic_field"][4000:5000] += 3e-6
    (output,) = _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE))
    status = output.attitude["status"]
    assert (status[4025:5000] & Status.MAG_DISTURBED > 0).all()
    assert not (status[5450:] & Status.MAG_DISTURBED).any()
    assert (status[4400:5000] & Status.GYRO_AIDED > 0).all()
    assert np.abs(wrap_pi(output.attitude["azimuth"][4000:] - 1.89)).max() < 0.01


def test_an_unplugged_magnetometer_leaves_the_azimuth_to_the_gyros_with_a_growing_sigma():
    imu, mag = _samples(seconds=60.0, rate=3.0, still_after=60.0)
    mag["magnetic_field"][3000:] = np.nan
    (output,) = _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE))
    attitude = output.attitude
    assert (attitude["status"][3400:] & (Status.NO_MAG | Status.GYRO_AIDED) == Status.NO_MAG | Status.GYRO_AIDED).all()
    assert attitude["sigma_azimuth"][-1] > attitude["sigma_azimuth"][3000]
    error = np.abs(wrap_pi(attitude["azimuth"] - 1.89))[3000:]
    assert (error < 3.0 * attitude["sigma_azimuth"][3000:]).all()


def test_dynamics_come_once_a_second_beside_the_attitude():
    imu, mag = _samples(seconds=16.0, rate=12.0, still_after=16.0)
    outputs = _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE), range(100, 1600, 100))
    dynamics = _joined(outputs, "dynamics")
    assert len(dynamics) == 15
    assert dynamics["rotary_speed"] == pytest.approx(12.0, abs=0.01)
    assert dynamics["status"][-1] & Status.ROTATING


@pytest.mark.fault_case(34)
def test_without_a_reference_the_azimuth_says_that_it_is_magnetic_and_uncorrected():
    imu, mag = _samples()
    (output,) = _run(imu, mag, Pipeline(EstimatorSettings()))
    last = output.attitude[-1]
    assert last["north"] == 1
    assert last["status"] & Status.NO_REFERENCE
    assert last["status"] & Status.UNCORRECTED
    (survey,) = output.surveys
    assert survey.station.north == "magnetic"
    assert survey.station.verdict == "doubtful"
    assert any("no reference field" in reason for reason in texts(survey.station.reasons))


@pytest.mark.fault_case(18)
def test_without_a_magnetometer_there_is_no_azimuth_but_everything_else():
    imu, _ = _samples()
    pipeline = Pipeline(EstimatorSettings(), REFERENCE)
    output = pipeline.push_imu(imu)
    assert np.isnan(output.attitude["sigma_azimuth"]).all()
    assert np.isnan(output.attitude["azimuth"]).all()
    assert (output.attitude["status"] & Status.NO_MAG > 0).all()
    assert output.attitude["inclination"][-1] == pytest.approx(0.8, abs=0.01)
    assert output.surveys[0].station.verdict == "reject"


def _chattering_plug(imu, mag, seconds):
    """The magnetometer is away for three seconds of each six."""
    return imu, mag[np.floor(seconds / 3.0) % 2.0 == 0.0]


def _returning_gyro(imu, mag, seconds):
    """The gyro comes back six seconds into the survey."""
    imu["angular_velocity"][seconds < 26.0] = np.nan
    return imu, mag


@pytest.mark.slow(0.3)
@pytest.mark.fault_case(19, 20)
@pytest.mark.parametrize("broken", [_chattering_plug, _returning_gyro])
def test_a_sensor_that_comes_and_goes_is_named_and_leaves_no_accepted_survey_nor_a_false_angle(broken):
    imu, mag = _samples(seconds=40.0, rate=10.0, still_after=20.0)
    imu, mag = broken(imu, mag, (imu["stamp_ns"] - START) * 1e-9)
    pipeline, outputs, given = Pipeline(EstimatorSettings(), REFERENCE), [], 0
    for block in np.split(imu, range(50, len(imu), 50)):
        until = int(np.searchsorted(mag["stamp_ns"], block["stamp_ns"][-1], side="right"))
        pipeline.push_mag(mag[given:until])
        outputs.append(pipeline.push_imu(block))
        given = until
    attitude = _joined(outputs, "attitude")
    for name, truth in (("inclination", 0.8), ("azimuth", 1.9)):
        known = np.isfinite(attitude[name])
        off = np.abs(wrap_pi(attitude[name][known] - truth))
        assert np.mean(off > 3.0 * attitude[f"sigma_{name}"][known]) < 0.02
    assert any(fault.code in (FaultCode.SILENT, FaultCode.INVALID) for output in outputs for fault in output.health)
    assert "accept" not in [survey.station.verdict for output in outputs for survey in output.surveys]


@pytest.mark.fault_case(3)
def test_what_comes_out_is_finite_or_unknown_together_with_its_sigma():
    imu, mag = _samples(seconds=6.0)
    imu["linear_acceleration"][100] = np.nan
    imu["angular_velocity"][200, 1] = np.inf
    mag["magnetic_field"][150:160] = np.nan
    imu["linear_acceleration"][300] = 1e308
    pipeline = Pipeline(EstimatorSettings(), REFERENCE)
    outputs = _run(imu, mag, pipeline)
    for name in ("attitude", "gravity", "interference", "dynamics"):
        samples = _joined(outputs, name)
        for field in samples.dtype.names:
            assert not np.isinf(samples[field]).any(), (name, field)
            if f"sigma_{field}" in samples.dtype.names:
                assert np.array_equal(np.isnan(samples[field]), np.isnan(samples[f"sigma_{field}"])), (name, field)
    gravity, attitude = _joined(outputs, "gravity"), _joined(outputs, "attitude")
    assert np.array_equal(np.isnan(gravity["gravity"]).any(axis=1), np.isnan(gravity["sigma"]))
    assert np.isfinite(attitude["azimuth"][400:]).all()
    assert pipeline.counters.rejected == 13


def test_a_magnetometer_beside_a_silent_imu_keeps_the_newest_samples_only():
    imu, mag = _samples(seconds=4.0)
    pipeline = Pipeline(EstimatorSettings(), REFERENCE)
    block = np.repeat(mag[:1], MOST_AHEAD // 10)
    for number in range(12, 0, -1):
        block["stamp_ns"] = mag["stamp_ns"][0] - 10_000_000 * np.arange(
            number * len(block), (number - 1) * len(block), -1
        )
        pipeline.push_mag(block.copy())
    assert pipeline.counters.rejected == 2 * len(block)
    pipeline.push_mag(mag)
    output = pipeline.push_imu(imu)
    assert np.isfinite(output.attitude["azimuth"][-1])


@pytest.mark.slow(3.5)
def test_what_is_kept_while_the_time_of_the_imu_stands_still_is_bounded(monkeypatch):
    monkeypatch.setattr(estimate, "MOST_AHEAD", 2000)
    imu, mag = _samples(seconds=4.0)
    pipeline, sizes = Pipeline(EstimatorSettings(), REFERENCE), []
    fine = imu.copy()
    _run(imu, mag, pipeline)
    imu["stamp_ns"] = imu["stamp_ns"][-1]
    tracemalloc.start()
    # The health of the sensors keeps up to 16 384 samples of the IMU, which come in 41 blocks; the
    # same number of the other two would be 6 MB.
    for _ in range(2):
        for _ in range(41):
            mag["stamp_ns"] += 4 * 10**9
            fine["stamp_ns"] += 4 * 10**9
            pipeline.push_mag(mag.copy())
            pipeline.push_precision(fine.copy())
            pipeline.push_imu(imu)
        gc.collect()
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert sizes[1] - sizes[0] < 100_000
    imu["stamp_ns"] = mag["stamp_ns"]
    output = pipeline.push_imu(imu)
    assert len(output.attitude) == len(imu)


@pytest.mark.slow(0.4)
@pytest.mark.fault_case(55)
@settings(max_examples=6)
@given(
    force=st.sampled_from([0.0, 1e-300, -9.81, 3000.0, np.nan]),
    places=st.lists(st.integers(200, 900), min_size=1, max_size=12),
    late_ms=st.integers(-700, 700),
)
def test_samples_of_a_rogue_among_those_of_the_tool_end_no_block_and_are_over_with_them(force, places, late_ms):
    imu, mag = _samples(seconds=20.0)
    parts, rogue = [], wire.IMU.empty(50)
    rogue["linear_acceleration"][:, 0] = force
    for start, stop in itertools.pairwise([0, *sorted(places), len(imu)]):
        parts.append(imu[start:stop])
        rogue["stamp_ns"] = imu["stamp_ns"][stop - 1] + late_ms * 10**6 + np.arange(50)
        parts.append(rogue.copy())
    pipeline = Pipeline(EstimatorSettings(), REFERENCE)
    pipeline.push_mag(mag)
    outputs = [pipeline.push_imu(block) for block in np.array_split(np.concatenate(parts), 9)]
    rows = _joined(outputs, "attitude")[-60:-50]
    assert rows["inclination"] == pytest.approx(0.8, abs=0.02)
    assert np.all((rows["sigma_inclination"] > 0.0) & (rows["sigma_inclination"] < 0.1))


@pytest.mark.fault_case(21)
def test_a_survey_asked_for_is_marked_and_one_while_turning_is_refused():
    imu, mag = _samples(seconds=20.0, rate=10.0, still_after=8.0)
    pipeline = Pipeline(EstimatorSettings(survey=SurveySettings(automatic=False)), REFERENCE)
    first = _run(imu[:400], mag[:400], pipeline)
    pipeline.request_survey()
    second = _run(imu[400:1000], mag[400:1000], pipeline)
    pipeline.request_survey(4.0)
    third = _run(imu[1000:], mag[1000:], pipeline)
    assert not first[0].surveys
    assert second[0].refusals[0].reason.code == ReasonCode.TOOL_TURNS
    (survey,) = third[0].surveys
    assert survey.average.requested
    assert survey.record().duration == pytest.approx(4.0)


def test_the_residual_of_a_bin_is_that_of_the_last_magnetic_sample_before_its_judgement():
    imu, mag = _samples(seconds=10.0)
    mag["magnetic_field"] *= np.linspace(1.0, 1.02, len(mag))[:, None]
    (output,) = _run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE))
    reported = output.interference
    assert len(reported) == 18
    # Judged one bin late, with the sample of 20 ms before.
    at = np.searchsorted(mag["stamp_ns"], reported["stamp_ns"] + 500_000_000 - 30_000_000)
    total = np.linalg.norm(mag["magnetic_field"], axis=1)[at]
    np.testing.assert_allclose(reported["total_residual"], total - REFERENCE.total, atol=1e-12)


def test_a_new_reference_holds_from_there_on():
    imu, mag = _samples()
    pipeline = Pipeline(EstimatorSettings())
    _run(imu[:800], mag[:800], pipeline)
    pipeline.set_reference(REFERENCE)
    (later,) = _run(imu[800:], mag[800:], pipeline)
    assert later.attitude["north"][0] == 3
    assert later.surveys[0].station.north == "grid"


def test_reset_forgets_the_estimate_but_not_the_numbering():
    imu, mag = _samples()
    pipeline = Pipeline(EstimatorSettings(), REFERENCE)
    _run(imu, mag, pipeline)
    pipeline.reset()
    assert pipeline.last_imu_ns < imu["stamp_ns"][0]
    imu["stamp_ns"] += 100 * 10**9
    mag["stamp_ns"] += 100 * 10**9
    (output,) = _run(imu, mag, pipeline)
    assert output.surveys[0].sequence == 2


@pytest.mark.parametrize("name", gravity.METHODS)
def test_every_gravity_method_takes_its_own_settings(name):
    settings = changed(EstimatorSettings(), {"gravity.method": name, "tool.accelerometer.range_g": [8.0, 16.0, 16.0]})
    params = derivation.gravity_params(settings, 9.7)
    assert type(params) is type(gravity.METHODS[name].Params())
    assert (params.gravity, params.accel_range) == (9.7, 8.0 * STANDARD_GRAVITY)


@pytest.mark.fault_case(43)
def test_time_that_goes_back_begins_the_estimate_anew_with_the_numbers_of_a_fresh_start():
    imu, mag = _samples(seconds=14.0)
    fresh = _joined(_run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE)), "attitude")
    for cuts in ((), (1399, 1400, 1401, 1402, 1403), (1000, 1500, 2000)):
        pipeline = Pipeline(EstimatorSettings(), REFERENCE)
        twice = _run(np.concatenate([imu, imu]), np.concatenate([mag, mag]), pipeline, cuts)
        attitude = _joined(twice, "attitude")
        assert attitude[:1400].tobytes() == fresh.tobytes()
        assert (attitude["status"][1400:1403] & Status.REJECTED > 0).all()
        assert attitude[1403:].tobytes() == fresh[3:].tobytes()
        surveys = [survey for output in twice for survey in output.surveys]
        assert [survey.sequence for survey in surveys] == [1, 2]
        # The same readings of the same time are the same survey, whatever its number.
        assert surveys[0].uuid == surveys[1].uuid
        assert pipeline.counters.set_back == 1


@functools.cache
def _twice(jump_s):
    """Samples that come twice, the second time `jump_s` after the first, and the attitude if none of them is late."""
    imu, mag = (np.concatenate([one, one]) for one in _samples(seconds=14.0))
    for samples in (imu, mag):
        samples["stamp_ns"][1400:] += int(jump_s * 1e9)
    return imu, mag, _joined(_run(imu, mag, Pipeline(EstimatorSettings(), REFERENCE)), "attitude").tobytes()


@pytest.mark.parametrize("late", [{0}, {700}, {1400}, {1402}, {1403}, {1400, 1401, 1402}])
@pytest.mark.parametrize("jump_s", [0.0, 14.0 + 1.1, 14.0 + 600.0])
def test_a_magnetic_sample_that_comes_after_the_imu_sample_of_its_time_changes_nothing(late, jump_s):
    """The time of the second samples goes back or has a gap; around a late sample they come one by one."""
    imu, mag, expected = _twice(jump_s)
    cuts = {*range(100, len(imu), 100), *(k for one in (*late, 1400) for k in range(max(one - 6, 1), one + 7))}
    pipeline, outputs = Pipeline(EstimatorSettings(), REFERENCE), []
    for block in np.split(np.arange(len(imu)), sorted(cuts)):
        before, after = (mag[:0], mag[block]) if block[0] in late else (mag[block], mag[:0])
        pipeline.push_mag(before)
        outputs.append(pipeline.push_imu(imu[block]))
        pipeline.push_mag(after)
    assert _joined(outputs, "attitude").tobytes() == expected


def test_gravity_that_a_smoother_followed_is_kept_where_time_goes_back():
    imu, mag = _samples(seconds=8.0)
    followed = gravity.method("bounded")
    one = followed.run(
        followed.Params(),
        followed.initial(followed.Params()),
        imu["stamp_ns"],
        imu["angular_velocity"],
        imu["linear_acceleration"],
    )
    both = Track(*(np.concatenate([column] * 2) for column in one))
    both.g_t[900:] = [0.6, 0.0, 0.8]
    pipeline = Pipeline(EstimatorSettings(), REFERENCE)
    pipeline.push_mag(np.concatenate([mag, mag]))
    output = pipeline.push_imu(np.concatenate([imu, imu]), both)
    assert pipeline.went_back == [(int(imu["stamp_ns"][-1]), int(imu["stamp_ns"][0]))]
    assert np.array_equal(output.gravity["gravity"][900:], both.g_t[900:])


def test_numbering_goes_on_after_what_others_remember():
    imu, mag = _samples()
    pipeline = Pipeline(EstimatorSettings(), REFERENCE)
    pipeline.continue_numbering(41)
    (output,) = _run(imu, mag, pipeline)
    assert output.surveys[0].sequence == 42


def test_a_recording_that_ends_while_a_survey_waits_for_the_gyro_gives_that_survey():
    imu, mag = _samples(seconds=25.0)
    pipeline = Pipeline(changed(EstimatorSettings(), {"place.lat_deg": 50.0}), REFERENCE)
    pipeline.push_mag(mag)
    fine = imu.copy()
    fine["angular_velocity"] *= 1e-2
    pipeline.push_precision(fine)
    assert not pipeline.push_imu(imu).surveys
    assert "needs 30 s" in text(pipeline.still.waits_for)
    (survey,) = pipeline.finish().surveys
    assert survey.record().duration > 20.0
    assert not pipeline.finish().surveys


def test_external_interference_between_two_stations_is_shown_by_what_the_gyros_carried_on_however_the_stream_is_cut():
    imu, mag = _samples(seconds=60.0, axial=0.0, rate=3.0, still_after=0.0)
    # Two still intervals with a shaken one between; then interference turns the field by 15 deg about the vertical.
    times = np.arange(len(imu)) * 0.01
    shaken = (times > 24.0) & (times < 32.0)
    imu["linear_acceleration"][shaken] += np.random.default_rng(5).normal(size=(int(shaken.sum()), 3))
    down = mat_nt(0.8, 1.9, 0.0)[2]
    field = mag["magnetic_field"][times >= 28.0]
    turn = np.radians(15.0)
    along = (field @ down)[:, None] * down
    mag["magnetic_field"][times >= 28.0] = along + (field - along) * np.cos(turn) + np.cross(down, field) * np.sin(turn)
    settings = changed(EstimatorSettings(), {"tool.gyro.bias_deg_h": 20.0})
    whole = [survey for output in _run(imu, mag, Pipeline(settings, REFERENCE)) for survey in output.surveys]
    pieces = _run(imu, mag, Pipeline(settings, REFERENCE), range(50, 6000, 370))
    assert [s.weights.get("carried") for s in whole] == [None, 0.0]
    first, second = whole
    assert first.station.verdict == "accept"
    assert second.station.verdict == "doubtful"
    assert second.station.headline.code == ReasonCode.PROPAGATED_DISAGREES
    assert abs(wrap_pi(second.station.by_method("carried").azimuth - 1.9)) < 3.0 * first.station.sigma_azimuth
    again = [survey for output in pieces for survey in output.surveys]
    assert [s.station.by_method("carried") for s in again] == [s.station.by_method("carried") for s in whole]


def test_clip_flags_reach_gravity_whatever_the_cut_and_a_clipped_field_is_not_used():
    imu, mag = _samples(rate=10.0, still_after=3.0)
    flagged = (np.arange(len(imu)) % 7 == 0)[:, None] & np.array([True, False, False])
    input_covariance.mark_clipped(imu, "linear_acceleration", flagged)
    bent = mag.copy()
    input_covariance.mark_clipped(bent, "magnetic_field", flagged)
    bent["magnetic_field"][flagged[:, 0]] += 3e-5
    outputs = [_run(imu, bent, Pipeline(EstimatorSettings(), REFERENCE), cuts) for cuts in ((), (5, 333, 900))]
    whole, cut = (_joined(one, "attitude") for one in outputs)
    assert whole.tobytes() == cut.tobytes()
    told = whole["status"] & int(Status.CLIPPED) != 0
    assert np.array_equal(told, flagged[:, 0])
    without = Pipeline(EstimatorSettings(), REFERENCE)
    keep = ~flagged[:, 0]
    without.push_mag(mag[keep])
    assert without.push_imu(imu).attitude.tobytes() == whole.tobytes()


def test_rows_and_surveys_of_a_tool_that_nobody_has_described_say_so_and_have_wide_sigmas():
    imu, mag = _samples(seconds=40.0, rate=3.0, still_after=12.0)
    described = changed(EstimatorSettings(), {"tool.accelerometer.misalignment_mrad": 0.1})
    found = {}
    for assumed, stated in ((True, EstimatorSettings()), (False, described)):
        outputs = _run(imu, mag, Pipeline(stated, REFERENCE))
        rows, surveys = _joined(outputs, "attitude"), [one for output in outputs for one in output.surveys]
        assert surveys
        for status in (*rows["status"], *_joined(outputs, "gravity")["status"], *(one.status for one in surveys)):
            assert bool(int(status) & Status.TOOL_ASSUMED) is assumed
        found[assumed] = rows
    wide, narrow = (found[assumed]["sigma_inclination"] for assumed in (True, False))
    assert (wide >= narrow).all()
    apart = np.abs(found[True]["inclination"] - found[False]["inclination"])
    assert not (apart > wide).any()
    assert np.median(wide / narrow) > 2.0


@pytest.mark.fault_case(8)
def test_innovations_count_what_the_field_check_rejects_however_the_stream_is_cut():
    imu, mag = _samples(seconds=40.0, rate=3.0, still_after=40.0)
    mag["magnetic_field"][3000:] += [0.0, 0.0, 8e-6]
    sound, whole, pieces = (Pipeline(EstimatorSettings(), REFERENCE) for _ in range(3))
    assert np.isnan([one.innovation for one in sound.innovations]).all()
    assert np.isnan([one.test_ratio for one in sound.innovations]).all()
    _run(imu[:3000], mag[:3000], sound)
    _run(imu, mag, whole)
    _run(imu, mag, pieces, range(70, 4000, 330))
    assert whole.innovations == pieces.innovations
    before, after = ({one.source: one for one in pipeline.innovations} for pipeline in (sound, whole))
    assert list(after) == ["gravity_inclination", "gravity_toolface", "magnetic_field", "magnetic_azimuth"]
    assert before["magnetic_field"].test_ratio < 1.0 < after["magnetic_field"].test_ratio
    assert before["magnetic_field"].rejected == before["magnetic_azimuth"].disturbed == 0
    assert after["magnetic_field"].rejected >= 0.9 * 10.0 / 0.2
    assert after["magnetic_field"].used == pytest.approx(30.0 / 0.2, abs=3)
    assert after["magnetic_azimuth"].disturbed >= 0.8 * after["magnetic_field"].rejected
    assert before["magnetic_azimuth"].used > 100
    assert 0.0 < before["gravity_inclination"].test_ratio < 20.0


@pytest.mark.slow(3)
@pytest.mark.fault_case(70)
def test_the_memory_of_the_estimator_does_not_grow_from_survey_to_survey(monkeypatch):
    # Of fewer stations than here, so that what is kept of them is full too.
    monkeypatch.setattr(decision, "_REVISABLE", 3)
    pipeline, surveys, sizes = Pipeline(EstimatorSettings(), REFERENCE), 0, []
    # Every other sample: what is kept depends on time.
    imu, mag = (samples[::2].copy() for samples in _samples(seconds=30.0, rate=10.0, still_after=12.0))
    tracemalloc.start()
    # After eleven minutes its histories are full.
    for rounds in (22, 10, 10):
        for _ in range(rounds):
            surveys += sum(len(output.surveys) for output in _run(imu, mag, pipeline, (500, 1000)))
            imu["stamp_ns"] += 30 * 10**9
            mag["stamp_ns"] += 30 * 10**9
        gc.collect()
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert surveys >= 41
    # Of 72 h, at one survey every 30 s, no more than 20 MB. The lists of free objects of Python and numpy may grow by
    # 3 kB a survey for a while, depending on the tests before.
    assert min(np.diff(sizes)) / 10 * 72 * 120 < 20e6


def test_a_magnetometer_in_a_frame_of_its_own_is_not_reported_as_one_that_never_came():
    plain = EstimatorSettings()
    apart = resolve(plain.tool.mount, {"imu": "imu_link", "mag": "mag_link"})
    assert "'mag_link'" in apart.unusable["mag"]
    assert "'imu_link'" in apart.unusable["mag"]
    imu = wire.IMU.empty(1500)
    imu["stamp_ns"] = np.arange(1500) * 10_000_000
    noise = np.random.default_rng(1).normal(scale=0.01, size=(1500, 3))
    imu["linear_acceleration"] = np.array([-9.0, 1.0, 3.7]) + noise
    named = {}
    for mount in (resolve(plain.tool.mount), apart):
        pipeline = Pipeline(plain, None, mount)
        named[bool(mount.unusable)] = {fault.code for fault in pipeline.push_imu(imu.copy()).health}
    assert FaultCode.NEVER_CAME in named[False]
    assert FaultCode.NEVER_CAME not in named[True]
