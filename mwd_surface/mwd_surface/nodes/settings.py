# SPDX-License-Identifier: Apache-2.0
"""Parameters of the surface node; each subpackage of mwd_surface defines its own parameters."""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting
from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.control.settings import ControlSettings
from mwd_surface.downlink.settings import DownlinkSettings
from mwd_surface.live.settings import WellSettings
from mwd_surface.page.foxglove_server import FoxgloveSettings
from mwd_surface.page.settings import PageSettings
from mwd_surface.rig.port import RigSettings
from mwd_surface.ros.topics import TOPICS
from mwd_surface.surveys.rods import RodSettings


@dataclasses.dataclass(frozen=True)
class RecordSettings:
    """Parameters of the recording."""

    enabled: bool = setting(True, "Start a recording when the node is activated.")
    name: str = setting(
        "", "Folder name of the recording; a number is added if a folder of this name exists. Empty: date and time."
    )
    topics: list[str] = setting(
        list(TOPICS),
        "Topics to record, relative to the well or absolute. A topic that does not exist yet is recorded as soon "
        "as it does. Each topic costs disk space; leave the list as it is unless a topic is to be added.",
    )


@dataclasses.dataclass(frozen=True)
class SurfaceSettings(WellSettings):
    """Parameters of the surface node: those of the well, and those of its recording and interfaces."""

    folder: str = setting(
        "~/mwd_data", "Folder of recordings, survey lists and exports; each well has its own folder in it."
    )
    serve_page: bool = setting(True, "Serve the live page.")
    strict: bool = setting(
        False, "Refuse to start if the page cannot be served; false: raise an alarm and try again every 5 s."
    )
    tool_file: str = setting(
        "",
        "Tool configuration (tool.yaml) whose section `health` states battery, limits and parts of the tool. "
        "Empty: typical values are used and marked as assumed.",
    )
    rods: RodSettings = setting(RodSettings, "Depth by counting rods.")
    record: RecordSettings = setting(RecordSettings, "Contents of the recording.")
    recorder: RecorderSettings = setting(RecorderSettings, "Files and buffers of the recorder.")
    page: PageSettings = setting(PageSettings, "The live page.")
    foxglove: FoxgloveSettings = setting(FoxgloveSettings, "Live server for Foxglove.")
    rig: RigSettings = setting(RigSettings, "Rig interfaces.")
    control: ControlSettings = setting(ControlSettings, "Control of top drive and pumps.")
    downlink: DownlinkSettings = setting(DownlinkSettings, "Commands to the tool by flow or rotation.")
