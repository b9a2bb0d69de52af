# SPDX-License-Identifier: Apache-2.0
"""The recorder under load, on a slow, full or failing disk, killed, and asked for what it cannot do."""

from __future__ import annotations

import dataclasses
import errno
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from unittest import mock

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from waiting import eventually

from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.mcap import recovery
from mwd_surface.bags.recorder.recorder import Recorder, recordings_named
from mwd_surface.bags.recorder.session import OVERHEAD
from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.bags.recorder.status import EventLevel, RecorderError, RecorderState
from project import ROOT

pytestmark = pytest.mark.slow(0.1)

START = 1_700_000_000_000_000_000
STRING, IMU = "std_msgs/msg/String", "sensor_msgs/msg/Imu"
EVENTS = "/recorder/events"
QUICK = RecorderSettings(chunk_seconds=0.05, sync_seconds=0.05, min_free_bytes=0, retry_seconds=0.05)
QOS = bag_metadata.qos_text([bag_metadata.qos_profile("best_effort", depth=5)])


def text(words: str) -> bytes:
    data = words.encode() + b"\0"
    return b"\0\1\0\0" + len(data).to_bytes(4, "little") + data


def recorded(path: Path, topic: str | None = "/a") -> list[tuple[int, bytes]]:
    with Bag(path) as bag:
        assert bag.complete
        return [(log_ns, data) for log_ns, name, _, data in bag.messages() if topic in (None, name)]


def events(path: Path) -> list[str]:
    with Bag(path) as bag:
        return [bag.decode(EVENTS, data).msg for _, _, _, data in bag.messages([EVENTS])]


def reported(recorder: Recorder, words: str) -> bool:
    return any(words in event.text for event in recorder.drain_events())


def put(recorder: Recorder, first: int, count: int, size: int = 300) -> int:
    return sum(recorder.put("/a", STRING, bytes(size), START + k * 1_000_000) for k in range(first, first + count))


def test_everything_handed_over_is_in_the_bag_with_its_stamps_and_bytes(tmp_path):
    stamps = [START + k * 1_000_000 for k in range(5000)]
    with Recorder(tmp_path, QUICK) as recorder:
        path = recorder.start("run")
        for k, stamp in enumerate(stamps):
            assert recorder.put("/well/a", STRING, text(f"a{k}"), stamp, stamp - 7, QOS)
            if k % 10 == 0:
                assert recorder.put("/well/b", IMU, bytes(340), stamp)
        assert recorder.stop() == path == tmp_path / "run"
        status = recorder.status()
    assert (status.state, status.path) == (RecorderState.STOPPED, "")
    with Reader(path) as reader:
        found = [(stamp, bytes(data)) for c, stamp, data in reader.messages() if c.topic == "/well/a"]
        a, b = (reader.topics[name] for name in ("/well/a", "/well/b"))
    assert found == [(stamp, text(f"a{k}")) for k, stamp in enumerate(stamps)]
    assert b.msgcount == 500
    assert a.connections[0].ext.offered_qos_profiles[0].depth == 5
    assert a.connections[0].digest.startswith("RIHS01_")
    with (path / "run_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert {m.log_time - m.publish_time for _, c, m in reader.iter_messages("/well/a")} == {7}
    assert recovery.check(path / "run_0.mcap").sound


def test_nothing_is_taken_while_nothing_is_recorded(tmp_path):
    with Recorder(tmp_path, QUICK) as recorder:
        assert put(recorder, 0, 3) == 0
        recorder.start("a")
        assert put(recorder, 0, 3) == 3
        recorder.stop()
        assert put(recorder, 0, 3) == 0
        recorder.start("b")
        assert recorder.status().dropped == 0
    assert len(recorded(tmp_path / "a")) == 3


@pytest.mark.fault_case(60)
def test_closing_finishes_the_file_in_three_seconds_with_thousands_of_messages_waiting(tmp_path):
    recorder = Recorder(tmp_path, RecorderSettings(min_free_bytes=0))
    path = recorder.start("run")
    taken = put(recorder, 0, 20_000)
    assert recorder.close()
    assert taken == 20_000
    assert len(recorded(path)) == taken
    assert recorder.close()


class Stall:
    """A disk that does not answer until it is let go."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.free, self.met = threading.Event(), threading.Event()
        real = os.write

        def write(file: int, data: bytes) -> int:
            if threading.current_thread().name == "recorder" and not self.free.is_set():
                self.met.set()
                self.free.wait(20)
            return real(file, data)

        monkeypatch.setattr(os, "write", write)


@pytest.mark.fault_case(64)
def test_a_stalled_disk_never_holds_the_caller_up_and_what_is_lost_is_counted_and_recorded(tmp_path, monkeypatch):
    settings = dataclasses.replace(QUICK, chunk_bytes=10_000, queue_bytes=100_000)
    with Recorder(tmp_path, settings) as recorder:
        path = recorder.start("run")
        put(recorder, 0, 10)
        eventually(lambda: recorder.status().messages >= 11)
        stall = Stall(monkeypatch)
        put(recorder, 10, 100)
        assert stall.met.wait(5)
        began = time.monotonic()
        taken = put(recorder, 110, 5000)
        # The disk would hold it up for 20 s.
        assert time.monotonic() - began < 10.0
        status = recorder.status()
        assert status.dropped == 5000 - taken > 4000
        assert status.queued_bytes <= status.queue_limit == 100_000
        stall.free.set()
        eventually(lambda: recorder.status().queued_bytes == 0)
        eventually(lambda: reported(recorder, "disk is slower"))
        recorder.stop()
    assert len(recorded(path)) == 110 + taken
    assert any(f"{5000 - taken} messages were lost" in line for line in events(path))


def test_closing_does_not_wait_for_a_disk_that_stays_silent(tmp_path, monkeypatch):
    recorder = Recorder(tmp_path, QUICK)
    recorder.start("run")
    stall = Stall(monkeypatch)
    put(recorder, 0, 10)
    assert stall.met.wait(5)
    began = time.monotonic()
    assert not recorder.close(timeout_s=0.5)
    assert time.monotonic() - began < 10.0
    stall.free.set()
    eventually(lambda: not recorder._thread.is_alive())


@pytest.mark.fault_case(59)
def test_a_killed_recorder_loses_less_than_two_seconds_and_the_next_start_recovers_the_rest(tmp_path):
    program = ROOT / "mwd_surface" / "test" / "programs" / "record_for_ever.py"
    process = subprocess.Popen([sys.executable, program, tmp_path], stdout=subprocess.PIPE, text=True)
    first, last = 0, 0
    for line in process.stdout:
        last = int(line)
        first = first or last
        if last - first > 2.7e9:
            break
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    with Recorder(tmp_path, QUICK) as recorder:
        recorder.start("next")
        eventually(lambda: reported(recorder, "recovered in run"))
        recorder.stop()
    assert len(list((tmp_path / "run").glob(f"*{recovery.KEPT}"))) == 1
    rows = recorded(tmp_path / "run")
    assert last - rows[-1][0] < 2.0e9
    assert [int.from_bytes(data[:8], "little") for _, data in rows] == list(range(len(rows)))
    assert any("recovered in run" in line for line in events(tmp_path / "next"))
    with Reader(tmp_path / "run") as reader:
        assert reader.topics["/a"].msgcount == len(rows)


@pytest.mark.parametrize("asked", [False, True])
def test_a_split_loses_no_message(tmp_path, asked):
    split_bytes = 0 if asked else 50_000
    settings = dataclasses.replace(QUICK, compression="none", chunk_bytes=5000, split_bytes=split_bytes)
    with Recorder(tmp_path, settings) as recorder:
        path, k = recorder.start("run"), 0
        while recorder.status().files < 4:
            k += put(recorder, k, 100)
            eventually(lambda: recorder.status().queued_bytes == 0)
            if asked:
                assert recorder.split().exists()
        recorder.stop()
    assert [log_ns for log_ns, _ in recorded(path)] == [START + n * 1_000_000 for n in range(k)]
    assert len(bag_metadata.read(path).files) >= 4
    for file in path.glob("*.mcap"):
        assert recovery.check(file).sound


@pytest.mark.fault_case(62)
def test_a_full_disk_pauses_the_recording_with_a_whole_file_and_space_resumes_it(tmp_path):
    space = [10**9]
    settings = dataclasses.replace(QUICK, min_free_bytes=10**8)
    with Recorder(tmp_path, settings, space=lambda _: space[0]) as recorder:
        path = recorder.start("run")
        put(recorder, 0, 100)
        eventually(lambda: recorder.status().messages >= 101)
        space[0] = 10**7
        eventually(lambda: recorder.status().state == RecorderState.PAUSED_DISK_FULL)
        assert recovery.check(path / "run_0.mcap").sound
        put(recorder, 100, 50)
        eventually(lambda: recorder.status().dropped == 50)
        with pytest.raises(RecorderError, match="paused"):
            recorder.split()
        space[0] = 10**9
        eventually(lambda: recorder.status().state == RecorderState.RECORDING)
        put(recorder, 150, 100)
        recorder.stop()
    assert [(log_ns - START) // 1_000_000 for log_ns, _ in recorded(path)] == [*range(100), *range(150, 250)]
    assert any("50 messages were lost" in line for line in events(path))
    assert len(bag_metadata.read(path).files) == 2


def test_a_real_full_disk_of_eight_megabytes_never_runs_over(tmp_path):
    mount = tmp_path / "small"
    mount.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(mount)], capture_output=True, check=False
    )
    if made.returncode:
        pytest.skip("this user may not mount a small disk")
    try:
        settings = RecorderSettings(
            compression="none", chunk_bytes=50_000, min_free_bytes=2_000_000, retry_seconds=0.05, split_bytes=1_000_000
        )
        with Recorder(mount, settings) as recorder:
            path, k = recorder.start("run"), 0
            while recorder.status().state == RecorderState.RECORDING:
                k += put(recorder, k, 200, 1000)
                eventually(lambda: recorder.status().queued_bytes == 0)
            assert recorder.status().state == RecorderState.PAUSED_DISK_FULL
            files = sorted(path.glob("*.mcap"))
            assert len(files) >= 4
            assert all(recovery.check(file).sound for file in files)
            files[0].unlink()
            files[1].unlink()
            files[2].unlink()
            eventually(lambda: recorder.status().state == RecorderState.RECORDING)
            put(recorder, k, 10, 1000)
            recorder.stop()
        with Bag(path) as bag:
            assert (START + k * 1_000_000) in {row[0] for row in bag.messages(["/a"])}
    finally:
        subprocess.run(["umount", str(mount)], check=True)


def test_too_little_space_at_the_start_is_refused_with_both_numbers(tmp_path):
    with (
        Recorder(tmp_path, RecorderSettings(), space=lambda _: 10**8) as recorder,
        pytest.raises(RecorderError, match=r"only 100 MB are free.*537 MB must stay free"),
    ):
        recorder.start()


@pytest.mark.fault_case(99)
def test_two_recorders_cannot_share_a_folder(tmp_path):
    with Recorder(tmp_path, QUICK), pytest.raises(RecorderError, match=f"process {os.getpid()}.*{tmp_path}"):
        Recorder(tmp_path, QUICK)
    Recorder(tmp_path, QUICK).close()


@pytest.mark.fault_case(63)
def test_a_folder_that_cannot_be_written_is_refused_with_its_path_and_reason(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(RecorderError, match=f"{tmp_path}/file.*File exists"):
        Recorder(tmp_path / "file", QUICK)
    with pytest.raises(RecorderError, match="Not a directory"):
        Recorder(tmp_path / "file" / "below", QUICK)


@pytest.mark.fault_case(65)
def test_too_many_open_files_are_an_error_in_words_and_the_recorder_lives_on(tmp_path):
    real = os.open

    def exhausted(path, *rest):
        if str(path).endswith(".mcap"):
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), str(path))
        return real(path, *rest)

    with Recorder(tmp_path, QUICK) as recorder:
        with mock.patch.object(os, "open", exhausted), pytest.raises(RecorderError, match="Too many open files"):
            recorder.start("one")
        recorder.start("two")
        put(recorder, 0, 5)
    assert len(recorded(tmp_path / "two")) == 5


@pytest.mark.fault_case(80)
@pytest.mark.parametrize("name", ["../x", "a/b", ".hidden"])
def test_a_name_that_leads_out_of_the_folder_is_refused(tmp_path, name):
    with Recorder(tmp_path, QUICK) as recorder, pytest.raises(RecorderError, match="not a plain name"):
        recorder.start(name)


def test_what_cannot_be_done_is_reported(tmp_path):
    with Recorder(tmp_path, QUICK) as recorder:
        for ask in (recorder.stop, recorder.split, lambda: recorder.attach("a", "b", b"", START)):
            with pytest.raises(RecorderError, match="no recording is running"):
                ask()
        with pytest.raises(RecorderError, match="snapshot_seconds is 0"):
            recorder.snapshot()
        path = recorder.start()
        assert path.name.startswith("mwd_2")
        with pytest.raises(RecorderError, match="running already"):
            recorder.start()
    with pytest.raises(RecorderError, match="closed"):
        recorder.start()


@pytest.mark.fault_case(59)
def test_a_name_that_is_taken_is_numbered_so_that_a_restart_records_again(tmp_path):
    made = []
    for k in range(3):
        with Recorder(tmp_path, QUICK) as recorder:
            made.append(recorder.start("fixed"))
            put(recorder, 10 * k, 10)
    assert [path.name for path in made] == ["fixed", "fixed_2", "fixed_3"]
    assert [len(recorded(path)) for path in made] == [10, 10, 10]
    assert recordings_named(tmp_path, "fixed") == made


def test_a_snapshot_holds_the_last_seconds_within_its_bounds(tmp_path):
    settings = dataclasses.replace(QUICK, snapshot_seconds=30.0, snapshot_bytes=100 * (300 + OVERHEAD))
    with Recorder(tmp_path, settings) as recorder:
        recorder.put("/a", STRING, bytes(settings.snapshot_bytes), START)  # too large to be kept
        with pytest.raises(RecorderError, match="nothing was received"):
            recorder.snapshot()
        put(recorder, 0, 1000)
        path = recorder.snapshot("kick")
        assert not recorder.status().path
    assert [(log_ns - START) // 1_000_000 for log_ns, _ in recorded(path)] == list(range(900, 1000))


def test_tables_attachments_and_events_are_inside_every_file_of_the_recording(tmp_path):
    with Recorder(tmp_path, QUICK, tables=lambda: {"versions": {"mwd_surface": "0.1.0"}}) as recorder:
        path = recorder.start("run", {"well": "F-4"})
        put(recorder, 0, 5)
        recorder.split()
        recorder.attach("report.html", "text/html", b"<p>", START)
        recorder.add_metadata("operator", {"name": "A. Driller"})
        put(recorder, 5, 5)
        recorder.stop()
    with Bag(path) as bag:
        assert bag.custom == {"well": "F-4"}
        assert bag.metadata()["operator"] == {"name": "A. Driller"}
        assert [item.name for item in bag.attachments()] == ["report.html"]
    for number in range(2):
        with (path / f"run_{number}.mcap").open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            names = [item.name for item in reader.iter_metadata()]
            assert names.count("versions") == names.count("rosbag2") == 1
            assert reader.get_summary().statistics.metadata_count == len(names)
            assert reader.get_summary().statistics.attachment_count == number
    assert recorder.drain_events()[0].level == EventLevel.INFO
    assert events(path)[0] == f"recording to {path}"


def test_a_recording_without_any_message_still_tells_when_it_ran(tmp_path):
    with Recorder(tmp_path, QUICK) as recorder:
        path = recorder.start("run")
    assert events(path) == [f"recording to {path}", f"recording of {path} stopped"]


def test_every_event_is_taken_once(tmp_path):
    with Recorder(tmp_path, QUICK) as recorder:
        recorder.start("run")
        assert [event.text for event in recorder.drain_events()] == [f"recording to {tmp_path / 'run'}"]
        assert recorder.drain_events() == []
        for k in range(250):
            recorder.put(f"/odd{k}", STRING, b"x", -1)
        eventually(lambda: recorder.status().dropped == 250)
        assert sum("before 1970" in event.text for event in recorder.drain_events()) == 250
