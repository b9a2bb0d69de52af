# SPDX-License-Identifier: Apache-2.0
"""Log samples computed from the raw data of a recording, by the kernels of the live estimator."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from mwd_estimation.core.input_gate import InputGate
from mwd_estimation.downhole.log_sampler import LogSampler
from mwd_estimation.pipeline.output import Output
from mwd_estimation.settings import derivation
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.survey import Survey
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.telemetry import log_channels, tool_configuration
from mwd_sensors.telemetry.log_channels import LogChannel, LogSample
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.logs.recorded_log import topic_of
from mwd_surface.processing.bag_estimate import BagEstimate
from mwd_surface.processing.bag_input import InputSettings, find_topics
from mwd_surface.surveys.recorded_settings import Recorded


def channels_of(tool_file: Path | None) -> dict[str, LogChannel]:
    """
    Return the log channels of a tool configuration; without a file, the default channels.

    Raises
    ------
    ValueError, OSError
        The file cannot be used.
    """
    return dict(log_channels.CHANNELS if tool_file is None else tool_configuration.read(tool_file).logged)


def computed_samples(
    bag: Bag,
    estimator: EstimatorSettings,
    given: InputSettings,
    channels: dict[str, LogChannel],
    recorded: Recorded | None = None,
    on_survey: Callable[[Survey], None] | None = None,
) -> list[LogSample]:
    """
    Return the log samples of a recording, as the live estimator computes them.

    channels : log channels to compute, by name.
    on_survey : called with each survey of the estimator.

    Raises BagError, ValueError as `process.process` does.
    """
    topics = find_topics(bag, given)
    namespace = topics.imu.removesuffix("imu/data_raw").strip("/")
    sampler, found = LogSampler(channels), list[LogSample]()
    beside = {
        stream: _all(bag, topic_of(bag, name, layout.type_name, namespace), layout)
        for stream, name, layout in (
            ("counts", wire.GAMMA_TOPIC, wire.COUNTS),
            ("status", wire.STATUS_TOPIC, wire.TOOL_STATUS),
        )
    }
    beside["temperature"] = _all(bag, topics.temperature, wire.TEMPERATURE)
    beside["temperature"] = InputGate(derivation.input_ranges(estimator)).temperature(beside["temperature"])

    def take(output: Output) -> None:
        if on_survey is not None:
            for survey in output.surveys:
                on_survey(survey.record(wire.SONDE_FRAME))
        if not len(output.attitude):
            return
        newest = output.attitude["stamp_ns"].max()
        for name, samples in beside.items():
            # Add the samples up to the newest attitude: the sampler needs them before the attitude of their time.
            later = np.flatnonzero(samples["stamp_ns"] > newest)
            cut = int(later[0]) if len(later) else len(samples)
            sampler.push(name, samples[:cut])
            beside[name] = samples[cut:]
        sampler.push("dynamics", output.dynamics)
        found.extend(sampler.advance(output.attitude))
        sampler.running.clear()

    BagEstimate(bag, estimator, given, recorded=recorded).run(take)
    return found + sampler.finish()


def _all(bag: Bag, topic: str | None, layout: wire.Layout) -> Samples:
    if topic is None:
        return layout.empty(0)
    return wire.decode_messages(layout, [data for _, _, _, data in bag.messages([topic])])[0]
