# SPDX-License-Identifier: Apache-2.0
"""The tool of a simulated run and its link, without middleware: samples to the estimator, words to the channel."""

from __future__ import annotations

from collections.abc import Mapping

from mwd_estimation.downhole.log_sampler import LogSampler
from mwd_estimation.downhole.transmitter import Sent, Transmitter
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.settings import from_mapping
from mwd_sensors.simulator.link_channels import Heard, OnAir
from mwd_sensors.simulator.sonde import Sonde
from mwd_sensors.simulator.telemetry_link import TelemetryLink
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_sensors.telemetry.tool_configuration import PULSE_CODES
from mwd_surface.runs.launch_plan import estimator_parameters

# Delay of the channel behind the samples, s: by then every word that the tool begins to send is known.
_LAG_S = 2.0


class SimulatedTool:
    """
    Estimator, transmitter and channel of a scenario with telemetry.

    Parameters
    ----------
    sonde : Sonde
        Sonde whose scenario has telemetry.

    Attributes
    ----------
    sent : list of Sent
        All words that were transmitted.
    surveys : list
        Surveys from the estimator.
    logs : list of LogSample
        Samples of the log channels.

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
        self.sent: list[Sent] = []
        self.surveys: list[object] = []
        self.logs: list[LogSample] = []

    @property
    def link(self) -> TelemetryLink:
        """The link with its channel."""
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
        """Return the rest of the received signal."""
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
        width = tool.pulse_width_s if tool.code in PULSE_CODES else tool.symbol_s
        frequency = tool.carrier.frequency_hz
        return OnAir(tool.link, start, sent.edges_s, sent.phases, sent.octets, width, frequency)

    def _flow(self, until_s: float) -> Samples:
        times, flows = self._link.flows(until_s)
        samples = wire.TOOL_FLOW.empty(len(times))
        samples["stamp_ns"] = [self._sonde.stamp_ns(float(at), of_tool=True) for at in times]
        samples["flow"], samples["sigma"] = flows, self._link.flow_sigma
        return samples


def estimator_settings(sonde: Sonde) -> EstimatorSettings:
    """Return settings of the estimator with the place and day of a run."""
    nested: dict[str, dict[str, object]] = {}
    for name, value in estimator_parameters(sonde.scenario).items():
        block, _, key = name.partition(".")
        nested.setdefault(block, {})[key] = value
    return from_mapping(EstimatorSettings, nested)
