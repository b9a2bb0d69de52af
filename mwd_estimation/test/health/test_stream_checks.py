# SPDX-License-Identifier: Apache-2.0
"""What the times of the samples show."""

import numpy as np
import pytest

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.health import fault_debounce as debounce
from mwd_estimation.health import signal_checks, stream_checks
from mwd_estimation.health.fault_debounce import AGAINST, FOR, NOTHING, OK
from mwd_estimation.health.motion_window import Samples
from mwd_estimation.health.signal_checks import SignalLimits

PERIOD = 10_000_000
N = 50


def half_second(stamps, stream=None, repeated=False):
    """Checks, whether samples come late, and the record of the stream, after samples at these times."""
    n = len(stamps)
    values = np.random.default_rng(1).standard_normal((200, 3))[: n + 150]
    if repeated:
        values[150:] = values[150 + np.arange(n) // 2 * 2]
    channels, checks = signal_checks.blank(), debounce.blank()
    # The least steps are those of a longer time than half a second.
    for c in range(6):
        signal_checks.count(channels[c], values, c % 3, 0, 150, np.inf)
        channels[c].n = channels[c].repeats = 0
        channels[c].total = channels[c].total2 = 0.0
        signal_checks.count(channels[c], values, c % 3, 150, n + 150, np.inf)
    s = np.zeros(1, stream_checks.STREAM)[0] if stream is None else stream
    s.first, s.stop, s.last_ns = 0, n, int(stamps[0]) - PERIOD
    empty = np.zeros((0, 3))
    samples = Samples(
        np.asarray(stamps, dtype=np.int64), values[150:], values[150:], np.zeros(0, dtype=np.int64), empty
    )
    return checks, stream_checks.judge_stream(SignalLimits(), checks, channels, s, samples, 0), s


@pytest.mark.fault_case(48)
def test_the_rate_is_learned_also_while_a_third_of_the_samples_is_lost():
    kept = np.flatnonzero(np.random.default_rng(2).random(N) > 0.33)
    _, late, stream = half_second(kept * PERIOD)
    assert stream.period == pytest.approx(0.01)
    assert not late


@pytest.mark.fault_case(49)
def test_a_changed_pace_is_seen_and_samples_far_apart_are_late():
    checks, late, stream = half_second(np.arange(N) * PERIOD)
    assert checks[FaultCode.RATE, 0].seen == AGAINST
    for factor, slow in ((3, True), (0.5, False)):
        checks, late, _ = half_second((np.arange(40) * factor * PERIOD).astype(np.int64), stream)
        assert checks[FaultCode.RATE, 0].seen == FOR
        assert late == slow
    # The limit is the rate that was learned.
    assert checks[FaultCode.RATE, 0].seen_limit == pytest.approx(100.0)


def test_values_that_are_sent_twice_are_seen():
    checks, _, _ = half_second(np.arange(N) * PERIOD, repeated=True)
    assert checks[FaultCode.REPEATED, 0].seen == checks[FaultCode.REPEATED, 3].seen == FOR
    assert checks[FaultCode.REPEATED, 0].seen_value == pytest.approx(0.5)
    assert half_second(np.arange(N) * PERIOD)[0][FaultCode.REPEATED, 0].seen == AGAINST


def test_stamps_that_stand_still_are_a_fault_and_right_ones_end_it():
    stream, checks = np.zeros(1, stream_checks.STREAM)[0], debounce.blank()
    changes = [stream_checks.judge_stamp(stream, checks, 7) for _ in range(101)]
    assert sum(changes) == 1
    changes = [stream_checks.judge_stamp(stream, checks, 8 + k) for k in range(500)]
    assert sum(changes) == 1
    assert checks[FaultCode.STAMPS, 0].state == OK


def test_a_missing_magnetometer_is_seen_as_silent_only_after_it_came():
    stream, checks, channels = np.zeros(1, stream_checks.STREAM)[0], debounce.blank(), signal_checks.blank()

    def seen(samples, stream=stream, expected=True):
        checks["seen"], channels[6].n = NOTHING, samples
        stream_checks.judge_silence(expected, stream, checks, channels, 0)
        return [int(checks[code, 6].seen) for code in (FaultCode.NEVER_CAME, FaultCode.SILENT)]

    assert seen(0) == [FOR, NOTHING]
    assert seen(5) == [AGAINST, AGAINST]
    assert seen(0) == [NOTHING, FOR]
    assert seen(0, np.zeros(1, stream_checks.STREAM)[0], expected=False) == [NOTHING, NOTHING]
