# SPDX-License-Identifier: Apache-2.0
"""What the recording server says of a recording that is wanted and cannot be."""

import pytest

pytest.importorskip("rclpy")

import logging
import shutil
import threading
import time
from types import SimpleNamespace

from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.bags.recorder.status import RecorderState
from mwd_surface.live.alarms import AlarmLog, Severity
from mwd_surface.live.well_state import WellState
from mwd_surface.nodes.recording_server import RecordingServer
from mwd_surface.nodes.settings import RecordSettings


def server(folder, name="", attachments=tuple, **recorder):
    alarm_log = AlarmLog(lambda: 0)
    node = SimpleNamespace(
        resolve_topic_name=lambda topic: f"/{topic}", get_logger=lambda: logging.getLogger("surface")
    )
    settings = SimpleNamespace(record=RecordSettings(name=name), recorder=RecorderSettings(**recorder))
    context = SimpleNamespace(
        node=node, folder=folder, live=SimpleNamespace(parts=WellState(over_link=False)), alarm_log=alarm_log
    )
    return RecordingServer(context, settings, tables=dict, attachments=attachments, on_start=lambda: None), alarm_log


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


def until(condition):
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        threading.Event().wait(0.01)


def answer():
    return SimpleNamespace(success=False, message="")


def test_the_answer_to_stop_says_what_the_recording_lacks(tmp_path, monkeypatch):
    files = [("surveys.csv", "text/csv", b"1")]
    kept, log = server(tmp_path, attachments=lambda: files, min_free_bytes=10**6, retry_seconds=0.05)
    assert kept.start(SimpleNamespace(name="whole"), answer()).success
    assert kept.put("/a", "std_msgs/msg/Empty", bytes(5), 10**18)
    stopped = kept.stop(None, answer())
    assert stopped.success
    assert stopped.message == f"finished {tmp_path / 'bags' / 'whole'}"
    assert kept.start(SimpleNamespace(name="full"), answer()).success
    assert kept.put("/a", "std_msgs/msg/Empty", bytes(5), 10**18)
    until(lambda: kept.status().messages > 0)
    full = shutil.disk_usage(tmp_path)._replace(free=0)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: full)
    until(lambda: kept.status().state == RecorderState.PAUSED_DISK_FULL)
    kept.put("/a", "std_msgs/msg/Empty", bytes(5), 10**18 + 1)
    assert not kept.split(None, answer()).success
    stopped = kept.stop(None, answer())
    assert stopped.success
    paused = "the recording is paused: 0 MB free"
    for words in (f"surveys.csv is not in the recording: {paused}", "1 messages were not recorded", "ended in a pause"):
        assert words in stopped.message, stopped.message
    assert log.events_after(0)[-1].severity == Severity.WARNING
    assert not kept.stop(None, answer()).success, "nothing is recorded"
    kept.close()
