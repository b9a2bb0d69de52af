# SPDX-License-Identifier: Apache-2.0
"""Memory of a tool: its clock is found with an honest sigma, gaps are filled, and nothing is counted twice."""

import dataclasses
import math

import example_surveys as example
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.logs.depth_log import ALL, DepthLog
from mwd_surface.logs.memory_clock import ClockError, MemoryClock, Rotation, memory_clock
from mwd_surface.logs.memory_merge import combined, improvements, in_run_time, with_surveys
from mwd_surface.surveys.depth import DepthReading
from mwd_surface.surveys.survey_list import SurveyList

S = 10**9
T0 = 10**18


def schedule(rng, hours=2.0):
    """Times, s, and speeds, rad/s, of the corners of a string that is turned and stopped."""
    corners, speeds, at = [0.0], [0.0], 0.0
    while at < hours * 3600.0:
        still, turns, speed = rng.uniform(60.0, 400.0), rng.uniform(200.0, 900.0), rng.uniform(8.0, 14.0)
        corners += [at + still, at + still + 5.0, at + still + 5.0 + turns, at + still + 10.0 + turns]
        speeds += [0.0, speed, speed, 0.0]
        at = corners[-1]
    return np.array(corners), np.array(speeds)


def recordings(seed, offset_s, drift, cut_s=(0.0, math.inf), hours=2.0, noise=0.1):
    """Rotation of the rig at 5 Hz and of the memory at 10 Hz, whose clock is off."""
    rng = np.random.default_rng(seed)
    corners, speeds = schedule(rng, hours)
    run_s = np.arange(0.0, corners[-1], 0.2)
    memory_s = np.arange(0.03, corners[-1], 0.1)
    memory_s = memory_s[(memory_s >= cut_s[0]) & (memory_s <= cut_s[1])]
    run = Rotation(T0 + np.round(run_s * S).astype(np.int64), np.interp(run_s, corners, speeds))
    speed = np.interp(memory_s, corners, speeds) + noise * rng.standard_normal(len(memory_s))
    stamps = T0 + np.round((memory_s * (1.0 + drift) + offset_s) * S).astype(np.int64)
    return run, Rotation(stamps, speed)


def offset_error(clock, offset_s, drift):
    true = offset_s + drift * (clock.reference_ns - T0) / S
    return clock.offset_s - true


@settings(max_examples=12)
@given(st.floats(-4000.0, 4000.0), st.floats(-1e-4, 1e-4), st.integers(0, 1000))
def test_offset_and_drift_are_found_whatever_they_are(offset_s, drift, seed):
    clock = memory_clock(*recordings(seed, offset_s, drift))
    assert abs(offset_error(clock, offset_s, drift)) < max(6.0 * clock.sigma_offset_s, 0.05)
    assert abs(clock.drift - drift) < max(6.0 * clock.sigma_drift, 1e-5)
    memory_ns = T0 + round((3600.0 * (1.0 + drift) + offset_s) * S)
    assert abs(clock.run_ns(memory_ns) - (T0 + 3600 * S)) < 0.1 * S


@pytest.mark.slow
def test_the_sigmas_of_offset_and_drift_are_honest():
    errors = []
    for seed in range(25):
        clock = memory_clock(*recordings(seed, 40.0, 30e-6))
        errors.append(
            (offset_error(clock, 40.0, 30e-6) / clock.sigma_offset_s, (clock.drift - 30e-6) / clock.sigma_drift)
        )
    errors = np.array(errors)
    assert np.all(np.sqrt(np.mean(errors**2, axis=0)) < 1.6)
    assert np.mean(np.abs(errors) < 2.0) > 0.85


def test_a_memory_that_lacks_the_begin_and_the_end_is_placed():
    clock = memory_clock(*recordings(4, -300.0, 0.0, cut_s=(1500.0, 6000.0)))
    assert offset_error(clock, -300.0, 0.0) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("changes", [1, 2, 3, 6])
def test_a_drift_is_known_from_three_changes_on(changes):
    """With fewer, the clock says so and its offset still holds."""
    edges = np.cumsum([300.0, 410.0, 290.0, 520.0, 350.0, 610.0])[:changes]
    corners = np.concatenate([[0.0], *[[edge, edge + 5.0] for edge in edges], [edges[-1] + 400.0]])
    speeds = np.array([0.0, *(10.0 * ((k + 1) // 2 % 2) for k in range(2 * changes)), 10.0 * (changes % 2)])
    run_s, memory_s = np.arange(0.0, corners[-1], 0.2), np.arange(0.0, corners[-1], 0.1)
    run = Rotation(T0 + np.round(run_s * S).astype(np.int64), np.interp(run_s, corners, speeds))
    stamps = T0 + np.round((memory_s + 40.0) * S).astype(np.int64)
    clock = memory_clock(run, Rotation(stamps, np.interp(memory_s, corners, speeds)))
    assert clock.changes == changes
    assert math.isnan(clock.drift) == math.isnan(clock.sigma_drift) == (changes < 3)
    assert ("not known" in str(clock)) == ("ppm" not in str(clock)) == (changes < 3)
    assert abs(clock.run_ns(T0 + 340 * S) - (T0 + 300 * S)) < 0.1 * S


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (recordings(8, 0.0, 0.0)[1], "same run"),
        (Rotation(np.array([T0, T0 + S]), np.array([0.0, 0.1])), "does not change in the memory"),
    ],
)
def test_a_memory_of_another_run_is_refused(other, words):
    with pytest.raises(ClockError, match=words):
        memory_clock(recordings(7, 0.0, 0.0)[0], other)


def test_a_rotation_that_repeats_itself_is_refused():
    at = np.arange(0.0, 4000.0, 0.2)
    speed = np.where(at % 200.0 < 100.0, 10.0, 0.0)
    regular = Rotation(T0 + np.round(at * S).astype(np.int64), speed)
    with pytest.raises(ClockError, match="repeats itself"):
        memory_clock(regular, dataclasses.replace(regular, stamp_ns=regular.stamp_ns + 40 * S))


def sample(at_s, channel="gamma", counts=100.0, value=80.0):
    return LogSample(T0 + round(at_s * S), channel, "gAPI", 2.0, 2.0, value, 8.0, counts=counts, sensor_to_bit=10.0)


def merged(samples):
    log = DepthLog()
    for at in range(2001):
        log.add_depth(T0 + at * S, 1000.0 + 0.01 * at)
    log.add(samples)
    log.finish()
    return log


def test_the_memory_fills_the_gaps_and_no_pulse_is_counted_twice():
    run = [sample(at) for at in range(1, 2000, 2) if not 600 < at < 900]
    run += [sample(at, "temperature", math.nan) for at in range(1, 2000, 2)]
    clock = memory_clock(*recordings(3, 40.0, 30e-6, hours=1.0))
    true = [sample(at) for at in range(201, 2000, 2)]
    own = [
        dataclasses.replace(one, stamp_ns=T0 + round(((one.stamp_ns - T0) / S * (1.0 + 30e-6) + 40.0) * S))
        for one in true
    ]
    memory = in_run_time(own, clock)
    assert max(abs(a.stamp_ns - b.stamp_ns) for a, b in zip(memory, true, strict=True)) < 0.1 * S
    together = combined(run, memory)
    log = merged(together)
    # 100 samples of the run before the memory begins, and the whole memory.
    assert np.nansum(log.curve("gamma", ALL).counts) == pytest.approx(100.0 * (100 + len(true)), rel=1e-3)
    assert log.curve("gamma").gaps == ()
    gamma, temperature = improvements(merged(run), log, merged(memory))
    assert gamma.channel == "gamma"
    assert gamma.filled == pytest.approx(30, abs=2)
    assert gamma.before + gamma.filled == gamma.steps
    assert temperature.filled == 0


spans = st.lists(st.tuples(st.integers(0, 400), st.integers(1, 40)), max_size=8)


@given(spans, spans)
def test_each_second_that_run_or_memory_measured_counts_once(of_run, of_memory):
    """Whatever holes run and memory have: no second is lost, none counts twice; ten pulses a second."""

    def samples(parts):
        found, at = [], 0
        for gap, span in parts:
            at += gap
            middle = sample(at + span / 2, counts=10.0 * span)
            found.append(dataclasses.replace(middle, span=float(span), duration=float(span)))
            at += span
        return found

    def seconds(samples):
        ends = [(one.stamp_ns - T0, round(one.span * S)) for one in samples]
        return {
            k for middle, span in ends for k in range(round((middle - span / 2) / S), round((middle + span / 2) / S))
        }

    run, memory = samples(of_run), samples(of_memory)
    together = combined(run, memory)
    union = seconds(run) | seconds(memory)
    assert seconds(together) == union
    assert sum(one.span for one in together) == pytest.approx(len(union))
    assert sum(one.duration for one in together) == pytest.approx(len(union))
    assert sum(one.counts for one in together) == pytest.approx(10.0 * len(union))
    for one in together:
        assert one.counts / one.duration == pytest.approx(10.0)


def test_a_hole_of_the_memory_keeps_the_run_and_its_sectors():
    run = [sample(at) for at in range(1, 2000, 2)]
    memory = [sample(at) for at in range(1, 2000, 2) if not 600 < at < 900]
    word = {"sectors": (50.0, math.nan), "sigma_sectors": (5.0, math.nan), "sector_durations": (1.0, 0.0)}
    words = [dataclasses.replace(sample(at, value=math.nan), **word) for at in (301, 701)]
    together = combined(run + words, memory)
    assert len(together) == len(run) + len(words)
    (one,) = improvements(merged(run), merged(together), merged(memory))
    assert (one.filled, one.lost) == (0, 0)
    # The count of lost steps sees what the memory alone would lack.
    (alone,) = improvements(merged(run), merged(memory), merged(memory))
    assert alone.lost == pytest.approx(30, abs=2)
    assert alone.before + alone.lost == one.before


def test_a_moment_is_kept_only_where_the_memory_has_none():
    moments = [dataclasses.replace(sample(at), span=0.0, duration=0.0) for at in (5.0, 50.0)]
    assert combined(moments, [sample(5.2)]) == [moments[1], sample(5.2)]


DEPTHS = {1: 300.0, 2: 330.0, 3: 360.0, 4: 390.0}
OFFSET_S, DRIFT = 40.0, 3e-5


def in_memory(survey, **changes):
    """The survey by the clock of the memory."""
    since = survey.stamp_ns - example.START
    stamp_ns = survey.stamp_ns + round(OFFSET_S * S + DRIFT * since)
    return dataclasses.replace(survey, stamp_ns=stamp_ns, uuid=f"memory {survey.sequence}", **changes)


@given(st.permutations(list(DEPTHS)))
def test_surveys_of_the_memory_become_revisions_or_are_added(order):
    clock = MemoryClock(example.START, OFFSET_S, 0.01, DRIFT, 1e-6, 1.0, 6)
    full = {k: example.survey(k, 10.0 + k, 80.0 + k) for k in DEPTHS}
    # Words over the link: whole degrees, ten seconds late. The fourth survey never arrived.
    listed = SurveyList(well=example.WELL)
    for k in (1, 2, 3):
        words = {"inclination": math.radians(round(10.0 + k)), "azimuth": full[k].azimuth + math.radians(0.6)}
        late = dataclasses.replace(
            full[k], stamp_ns=full[k].stamp_ns + 10 * S, reasons=("received over mud pulse",), **words
        )
        listed = listed.add(late if k != 3 else full[k], DEPTHS[k], 0.0)
    depths = {full[k].stamp_ns: depth for k, depth in DEPTHS.items()}
    memory = [in_memory(full[k], azimuth=full[k].azimuth) for k in order]
    merged, revised, added = with_surveys(
        listed, memory, clock, lambda at: DepthReading(depths[min(depths, key=lambda one: abs(one - at))], 0.0)
    )
    assert (revised, added) == (2, 1)
    by_depth = {record.measured_depth: record for record in merged.records}
    for k in (1, 2):
        record = by_depth[DEPTHS[k]]
        assert record.survey.azimuth == full[k].azimuth
        assert record.survey.uuid == full[k].uuid
        assert record.as_first_decided.azimuth != full[k].azimuth
        assert "memory" in record.revised_because
        assert abs(record.survey.stamp_ns - full[k].stamp_ns) < 0.01 * S
    # The run had the third survey's own readings.
    assert by_depth[DEPTHS[3]].survey == full[3]
    assert by_depth[DEPTHS[4]].survey.azimuth == full[4].azimuth
    again, *_ = with_surveys(merged, memory, clock, lambda _: DepthReading())
    assert len(again.records) == len(merged.records)
