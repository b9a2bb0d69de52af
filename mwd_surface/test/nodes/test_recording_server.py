# SPDX-License-Identifier: Apache-2.0
"""What the recording server says of a recording that is wanted and cannot be."""

import pytest

pytest.importorskip("rclpy")

from types import SimpleNamespace

from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.well_state import WellState
from mwd_surface.nodes.recording_server import RecordingServer
from mwd_surface.nodes.settings import RecordSettings


def server(folder, name="", **recorder):
    alarm_log = AlarmLog(lambda: 0)
    node = SimpleNamespace(resolve_topic_name=lambda topic: f"/{topic}")
    settings = SimpleNamespace(record=RecordSettings(name=name), recorder=RecorderSettings(**recorder))
    context = SimpleNamespace(
        node=node, folder=folder, live=SimpleNamespace(parts=WellState(over_link=False)), alarm_log=alarm_log
    )
    return RecordingServer(context, settings, tables=dict, attachments=tuple, on_start=lambda: None), alarm_log


@pytest.mark.fault_case(62)
def test_a_recording_that_cannot_start_is_named_with_its_own_remedy(tmp_path):
    full, log = server(tmp_path, min_free_bytes=2**60)
    full.activate()
    (shown,) = full.diagnostics()
    assert shown.level != 0
    assert "not recording" in shown.message
    assert "free space on the disk" in shown.remedy
    assert [alarm.id for alarm in log.alarms()] == ["recording.start"]
    full.close()


def test_a_name_that_is_no_name_is_not_blamed_on_the_disk(tmp_path):
    named, _ = server(tmp_path, name="../elsewhere", min_free_bytes=0)
    named.activate()
    (shown,) = named.diagnostics()
    assert "not a plain name" in shown.message
    assert "disk" not in shown.remedy
    named.close()


@pytest.mark.fault_case(59)
def test_after_a_crash_a_fixed_name_records_again(tmp_path):
    for _ in range(2):
        fixed, log = server(tmp_path, name="fixed", min_free_bytes=0)
        fixed.activate()
        assert fixed.diagnostics()[0].message == "recording"
        assert not log.alarms()
        fixed.close()
    assert sorted(path.name for path in (tmp_path / "bags").glob("fixed*")) == ["fixed", "fixed_2"]
