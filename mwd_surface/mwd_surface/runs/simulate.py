# SPDX-License-Identifier: Apache-2.0
"""Simulation of a scenario to a recording, without middleware, with the messages that the sonde node would publish."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mwd_estimation.downhole.log_sampler import LogSampler
from mwd_estimation.downhole.transmitter import Sent, Transmitter
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import gauge_burst, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.settings import changed
from mwd_sensors.simulator.scenario import Scenario
from mwd_sensors.simulator.sonde import Sonde
from mwd_sensors.simulator.telemetry_link import Heard, OnAir, TelemetryLink
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.bags.bag_metadata import qos_profile
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.runs import launch_plan
from mwd_surface.runs.launch_plan import estimator_parameters
from mwd_surface.surveys.recorded_settings import ESTIMATOR, SURFACE

_BLOCK_S = 1.0  # length of a block of samples, s
# QoS profiles as named in `mwd_sensors.ros.qos`: STREAM, and EVENT for the rig.
_STREAM = qos_profile(depth=200)
_EVENT = qos_profile(durability="transient_local", depth=100)


def record(
    scenario: Scenario,
    path: Path,
    namespace: str = "",
    source: bytes = b"",
    progress: Callable[[float], None] = lambda _share: None,
) -> tuple[int, float]:
    """
    Simulate a scenario and write its bag.

    Parameters
    ----------
    path : Path
        Folder of the bag.
    namespace : str
        Prefix of the relative topic names.
    source : bytes
        Content of the scenario file, which is stored inside the bag.
    progress : callable
        Called with the completed share, 0 to 1.

    Returns
    -------
    (messages, seconds of the run)

    Raises
    ------
    FileExistsError
        `path` exists.
    OSError
        The bag cannot be written.
    """
    sonde = Sonde(scenario)
    prefix = "/" + namespace.strip("/") + "/" if namespace.strip("/") else "/"
    with BagWriter(path, custom={"scenario": scenario.name, "seed": str(scenario.seed)}) as bag:
        channels = {
            name: bag.topic(prefix + name, layout.type_name, [_EVENT if name == "rig/state" else _STREAM])
            for name, layout in sonde.topics.items()
        }
        if source:
            bag.attach("scenario.yaml", "application/yaml", source, sonde.epoch_ns)
        link = None if sonde.link is None else _LinkWriter(sonde, bag, prefix)
        done = 0.0
        for block in sonde.blocks(_BLOCK_S):
            for name, samples in block.items():
                frame = prefix[1:] + (wire.RIG_FRAME if name == "rig/state" else wire.SONDE_FRAME)
                rows = sonde.topics[name].encode(samples, frame)
                bag.write_rows(channels[name], rows, samples["stamp_ns"])
            done += _BLOCK_S
            if link is not None:
                link.take(block, min(done, sonde.duration))
            progress(min(done / sonde.duration, 1.0))
        if link is not None:
            link.finish()
        for name, table in _parameters(scenario, namespace).items():
            bag.add_metadata(name, {key: str(value) for key, value in table.items()})
        count = bag.messages
    return count, sonde.duration


def _parameters(scenario: Scenario, namespace: str) -> dict[str, dict[str, Any]]:
    """Return the parameters for place, day and well of a scenario, by node, as recorded in a run of `mwd run`."""
    surface = launch_plan.surface_parameters(scenario)
    if namespace.strip("/"):
        surface["well.name"] = namespace.strip("/")
    return {ESTIMATOR: launch_plan.estimator_parameters(scenario), SURFACE: surface}


class _LinkWriter:
    """
    Writer of the flow at the tool, and of the signal that is received at the surface.

    An estimator runs to provide the telemetry words.
    """

    def __init__(self, sonde: Sonde, bag: BagWriter, prefix: str) -> None:
        self._sonde, self._bag = sonde, bag
        self._tool = SimulatedTool(sonde)
        self._flow = bag.topic(prefix + "tool/flow", wire.TOOL_FLOW.type_name, [_EVENT])
        self._heard = {link: bag.topic(prefix + name, kind, [_EVENT]) for link, (name, kind) in _topics(sonde)}
        if "mud_pulse" in self._heard:
            self._strokes = bag.topic(prefix + "rig/strokes", gauge_burst.STROKES, [_EVENT])

    def take(self, block: Mapping[str, Samples], until_s: float) -> None:
        """Process the samples of a block that ends at run time `until_s`, s."""
        flow, heard = self._tool.take(block, until_s)
        self._bag.write_rows(self._flow, wire.TOOL_FLOW.encode(flow, wire.SONDE_FRAME), flow["stamp_ns"])
        self._write(heard)

    def finish(self) -> None:
        """Write the received signal that is not written yet."""
        self._write(self._tool.finish())

    def _write(self, heard: list[Heard]) -> None:
        for one in heard:
            stamp_ns = self._sonde.stamp_ns(one.start_s, of_tool=False)
            data = gauge_burst.encode(stamp_ns, one.period_s, one.values)
            self._bag.write(self._heard[one.link], data, stamp_ns)
            if one.link == "mud_pulse":
                until_ns = stamp_ns + round(len(one.values) * one.period_s * wire.NANOSECONDS)
                strokes = [(pump, self._sonde.stamp_ns(at, of_tool=False)) for pump, at in one.strokes]
                self._bag.write(self._strokes, gauge_burst.encode_strokes(until_ns, strokes), until_ns)


def _topics(sonde: Sonde) -> list[tuple[str, tuple[str, str]]]:
    """Return the links of a run with topic and type of the received signal."""
    tools = () if sonde.scenario.telemetry is None else sonde.scenario.telemetry.tools
    return [(tool.link, gauge_burst.TOPICS[tool.link]) for tool in tools]


# Tool of a simulated run and its telemetry link, without middleware: samples go to the estimator, words to the channel.


# Time by which the simulation of the channel lags behind the samples, s. A transmitter reports a word sooner than this
# after the start of the word.
_LAG_S = 2.0


class SimulatedTool:
    """
    Estimator, transmitter and channel of a scenario with telemetry.

    Parameters
    ----------
    sonde : Sonde
        Sonde whose scenario has telemetry.

    Raises
    ------
    ValueError
        The scenario has no telemetry.
    """

    def __init__(self, sonde: Sonde) -> None:
        if sonde.link is None or sonde.scenario.telemetry is None:
            raise ValueError("the scenario has no telemetry; it needs an entry `telemetry: {}`")
        self._sonde, self._link = sonde, sonde.link
        self._pipeline = Pipeline(estimator_settings(sonde))
        transmit = self._pipeline.settings.transmit
        self._transmitters = [Transmitter(tool, transmit) for tool in sonde.scenario.telemetry.tools]
        self._logs = LogSampler(sonde.scenario.telemetry.tools[0].logged)
        self._done = 0.0
        self.sent: list[Sent] = []  #: all words that were transmitted
        self.surveys: list[object] = []  #: surveys from the estimator
        self.logs: list[LogSample] = []  #: samples of the log channels

    @property
    def link(self) -> TelemetryLink:
        """Telemetry link with its channel."""
        return self._link

    def take(self, block: Mapping[str, Samples], until_s: float) -> tuple[Samples, list[Heard]]:
        """
        Process the samples of the sonde up to run time `until_s`, s.

        Returns
        -------
        ndarray of `wire.TOOL_FLOW`
            Flow as measured by the tool.
        list of Heard
            Signal received at the surface.
        """
        flow = self._flow(until_s)
        pipeline, imu = self._pipeline, block["imu/data_raw"]
        imu_t = pipeline.mount.imu_in_tool(pipeline.gate.imu(imu))
        for transmitter in self._transmitters:
            transmitter.take_flow(flow)
            transmitter.take_rotation(imu_t)
        pipeline.push_mag(block["imu/mag"])
        pipeline.push_precision(block["gyro/data_raw"])
        pipeline.push_temperature(block["imu/temperature"])
        self._logs.push("temperature", pipeline.gate.temperature(block["imu/temperature"]))
        self._logs.push("counts", block.get(wire.GAMMA_TOPIC, wire.COUNTS.empty(0)))
        self._logs.push("status", block.get(wire.STATUS_TOPIC, wire.TOOL_STATUS.empty(0)))
        self._take_output(pipeline.push_imu(imu))
        self._done = until_s
        return flow, self._link.advance(until_s - _LAG_S)

    def finish(self) -> list[Heard]:
        """Return the received signal that `take` has not returned yet."""
        return self._link.advance(self._done)

    def _take_output(self, output: Output) -> None:
        self.surveys += output.surveys
        self._logs.push("dynamics", output.dynamics)
        self.logs += self._logs.advance(output.attitude)
        for transmitter in self._transmitters:
            for survey in output.surveys:
                transmitter.take_survey(survey)
            transmitter.take_dynamics(output.dynamics)
            for running in self._logs.running:
                transmitter.take_logs(*running)
            for sent in transmitter.advance(output.attitude, self._pipeline.reference):
                self.sent.append(sent)
                self._link.send(self._on_air(sent))
        self._logs.running.clear()

    def _on_air(self, sent: Sent) -> OnAir:
        tool = sent.tool
        start = self._sonde.seconds(sent.start_ns)
        width = tool.pulse_width_s if tool.code == "mary" else tool.symbol_s
        frequency = tool.carrier.frequency_hz
        return OnAir(tool.link, start, sent.edges_s, sent.phases, sent.octets, width, frequency)

    def _flow(self, until_s: float) -> Samples:
        times, flows = self._link.flows(until_s)
        samples = wire.TOOL_FLOW.empty(len(times))
        samples["stamp_ns"] = [self._sonde.stamp_ns(float(at), of_tool=True) for at in times]
        samples["flow"], samples["sigma"] = flows, self._link.flow_sigma
        return samples


def estimator_settings(sonde: Sonde) -> EstimatorSettings:
    """Return settings of the estimator for the scenario of a sonde: place, day or field, and the string."""
    return changed(EstimatorSettings(), estimator_parameters(sonde.scenario))
