# SPDX-License-Identifier: Apache-2.0
"""Log samples from words: value, time and sigma against what the tool measured."""

import math

import example_words
import numpy as np
import pytest

from mwd_estimation.downhole.log_sampler import LogSampler
from mwd_estimation.downhole.settings import Transmit
from mwd_estimation.downhole.transmitter import Transmitter
from mwd_sensors.core import wire
from mwd_sensors.telemetry import meanings, tool_configuration
from mwd_sensors.telemetry.log_channels import FROM_WORD
from mwd_surface.receiver.link.link_log import log_samples, survey_samples
from mwd_surface.receiver.link.link_survey import HeardSurvey, SurveyTime
from mwd_surface.receiver.words import ERASED, LinkValue

TOOL = tool_configuration.from_mapping(
    {
        "code": "serial",
        "channels": {
            "gamma": {
                "interval_s": 5,
                "sectors": 4,
                "word": "Gama",
                "sector_words": ["GU", "GR", "GD", "GL"],
                "tool_factor": 1.5,
                "sensor_to_bit_m": 8.0,
            },
            "inclination": {"source": "inclination", "word": "RINC"},
            "temperature": {"source": "temperature", "word": "Temp"},
        },
        "words": {
            "Gama": {"bits": 8, "high": 255.0, "unit": "cps"},
            **{name: {"bits": 7, "high": 254.0, "unit": "gAPI"} for name in ("GU", "GR", "GD", "GL")},
        },
        "survey_sequences": ["Inc:12 Azm:12 Temp:8"],
        "toolface_sequences": ["Gama:8 GU:7 GR:7 GD:7 GL:7 RINC:11"],
    }
)
S = 10**9
T0 = 10**18


def sent_words(seconds=60):
    """All that a wired tool sends whose gamma rises with time: 60 + 2 t API."""
    rng = np.random.default_rng(2)
    stamps = T0 + np.arange(1, seconds * 100 + 1) * (S // 100)
    attitude = wire.ATTITUDE.empty(len(stamps))
    attitude["stamp_ns"], attitude["sigma_inclination"], attitude["inclination"] = stamps, 0.001, 1.2
    attitude["gravity_toolface"] = (np.arange(len(stamps)) * 0.11) % math.tau
    attitude["sigma_gravity_toolface"] = 0.01
    counts = wire.COUNTS.empty(seconds * 25)
    counts["stamp_ns"], counts["duration"] = stamps[3::4], 0.04
    at = (counts["stamp_ns"] - T0) / S
    counts["counts"] = rng.poisson((60.0 + 2.0 * at) / 1.5 * 0.04)
    counts["tool_factor"], counts["sensor_to_bit"] = 1.5, 8.0
    sampler, transmitter = LogSampler(TOOL.logged), Transmitter(TOOL, Transmit())
    sampler.push("counts", counts)
    sent = []
    for k in range(seconds):
        rows = attitude[100 * k : 100 * k + 100]
        sampler.advance(rows)
        for running in sampler.running:
            transmitter.take_logs(*running)
        sampler.running.clear()
        sent += transmitter.advance(rows, None)
    return sent


def received(one, **fields):
    given = {"kind": "toolface", "frame": one.frame, "start_s": (one.start_ns - T0) / S, **fields}
    return example_words.received(one.name, raw=one.raw, bits=one.bits, table=TOOL.table, **given)


def samples(words):
    return list(log_samples(words, TOOL, lambda seconds: T0 + round(seconds * S)))


SENT = [one for one in sent_words() if one.reading is not None]


def test_a_received_value_has_the_time_and_the_value_that_the_tool_measured():
    """Within the second by which the tool's mean may be older, and within the step of the word."""
    errors = []
    for one in SENT:
        (sample,) = samples([received(one)])
        if one.name == "RINC":
            assert sample.value == pytest.approx(1.2, abs=0.002)
            continue
        assert abs(sample.stamp_ns - one.reading.stamp_ns) <= 0.5 * S
        assert sample.quality == FROM_WORD
        assert sample.unit == "gAPI"
        assert sample.sensor_to_bit == 8.0
        if one.name == "Gama":
            true = 60.0 + 2.0 * (sample.stamp_ns - T0) / S
            errors.append((sample.value - true) / sample.sigma)
        else:
            place = ("GU", "GR", "GD", "GL").index(one.name)
            assert [math.isfinite(v) for v in sample.sectors] == [k == place for k in range(4)]
            assert math.isnan(sample.value)
    assert len(errors) > 20
    assert np.sqrt(np.mean(np.square(errors))) < 1.6


def test_only_final_believed_words_of_a_channel_count():
    gamma = next(one for one in SENT if one.name == "Gama")
    assert samples([received(gamma, status=ERASED)]) == []
    assert samples([received(gamma, revision=0)]) == []
    assert len(samples([received(gamma)])) == 1


def test_words_of_a_survey_give_samples_at_the_time_of_the_survey():
    """Also in the unit of the channel: the words of a survey are SI when they are believed."""
    hot = LinkValue(61.3, 0.3, 78, 100.0, 101.0)
    heard = HeardSurvey(TOOL.link, SurveyTime(T0, 10.0), {meanings.TEMPERATURE: hot, meanings.INCLINATION: hot})
    (sample,) = survey_samples(heard, TOOL)
    assert (sample.channel, sample.stamp_ns, sample.value, sample.sigma) == ("temperature", T0, 61.3, 0.3)
    assert (sample.link, sample.quality, sample.span) == (TOOL.link, FROM_WORD, 0.0)
