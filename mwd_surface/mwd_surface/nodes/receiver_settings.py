# SPDX-License-Identifier: Apache-2.0
"""Parameters of the receiver node."""

from __future__ import annotations

import dataclasses

from mwd_estimation.settings.place import Place
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_sensors.core.settings import setting
from mwd_surface.receiver.link.link_attitude import AgeRules


@dataclasses.dataclass(frozen=True)
class ReceiverSettings:
    """Parameters of the receiver node."""

    tool_file: str = setting(
        "",
        "Tool configuration (tool.yaml) of the transmitting tool. With a wrong file no word is received, and the "
        "status of the link names the reason.",
    )
    second_tool_file: str = setting(
        "",
        "Tool configuration of a second link, such as EM in addition to mud pulses. Surveys and attitude come from "
        "both links; the better word is used. Empty: one link.",
    )
    serial_port: str = setting(
        "",
        "Serial port of the surface unit of a wired tool, such as /dev/ttyUSB0. Its bytes are published on "
        "rig/serial. Empty: another node publishes the bytes on rig/serial.",
    )
    gauge: int = setting(1, "Gauge of a link through mud: 1 reads rig/standpipe, 2 rig/standpipe_2.", low=1, high=2)
    tool_code: str = setting(
        "", "ISCWSA / OWSG tool code that gives the sigma of surveys if the tool sends none. Empty: an ordinary MWD."
    )
    place: Place = setting(Place, "The place of the well, its magnetic field and gravity, as in the estimator.")
    verdict: QualitySettings = setting(
        QualitySettings, "Acceptance criteria of a survey of the link, as in the estimator."
    )
    ages: AgeRules = setting(AgeRules, "Ageing of received values: the sigma grows, and an old toolface is withheld.")
