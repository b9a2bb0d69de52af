# SPDX-License-Identifier: Apache-2.0
"""What the surface keeps of the downlink over a restart."""

import pytest

from mwd_sensors.telemetry.downlink import Downlink
from mwd_sensors.telemetry.tool_commands import ToolSettings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.downlink.machine import Machine
from mwd_surface.downlink.memory import Kept, Memory
from mwd_surface.downlink.settings import DownlinkSettings
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.page.state_json import plain

TOOL = ToolConfiguration(downlink=Downlink(pulse_widths_s=(0.3, 0.5)))


def test_what_was_kept_comes_back(tmp_path):
    file = tmp_path / "w1" / "downlink.json"
    assert Memory(file).read(TOOL) == Kept()
    kept = Kept(ToolSettings(pulse_width=1), 4, 9, 513, (514, 515))
    Memory(file).write(kept)
    assert Memory(file).read(TOOL) == kept
    assert Kept.of(kept.machine(TOOL, DownlinkSettings())) == kept


def test_settings_that_the_tool_does_not_have_are_those_of_another_tool(tmp_path):
    file = tmp_path / "downlink.json"
    Memory(file).write(Kept(ToolSettings(pulse_width=7), 4, 9))
    assert Memory(file).read(TOOL) == Kept(ToolSettings(), 4, 9)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "[" * 9_000,
        '{"in_force": {"speed": 1}, "counter": 1}',
        '{"counter": 1}',
        '{"in_force": {}, "counter": 1e999}',
        '{"in_force": {"sequence": "1"}, "counter": 1}',
        '{"in_force": {"mute": 0}, "counter": 1}',
        '{"in_force": {}, "counter": 1, "number": 1, "heard": "7", "sent": []}',
        '{"in_force": {}, "counter": 1, "number": 1, "heard": null, "sent": [1.5]}',
        '{"in_force": {}, "counter": 1, "more": "' + "x" * 20_000 + '"}',
    ],
)
def test_a_file_that_cannot_be_read_says_what_to_do(tmp_path, text):
    file = tmp_path / "downlink.json"
    file.write_text(text)
    with pytest.raises(ValueError, match="delete it"):
        Memory(file).read(TOOL)


def test_the_page_shows_the_command_its_programme_and_what_can_be_sent():
    machine = Machine(TOOL, DownlinkSettings())
    table = plain(DownlinkStatus.of(machine, 0.0))
    assert (table["state"], table["base"]) == ("idle", None)
    assert ["pulse_width", [0.3, 0.5]] in table["choices"]
    machine.draft("pulse_width", 0.5, "Ann", 1.0)
    table = plain(DownlinkStatus.of(machine, 1.0))
    assert (table["state"], table["about"], table["requested_by"]) == ("draft", "pulse width 0.5 s", "Ann")
    assert (table["symbols"], table["symbol"]) == (12, 0)
    assert table["remaining"] == pytest.approx(machine.programme.duration_s)
