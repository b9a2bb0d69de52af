# SPDX-License-Identifier: Apache-2.0
"""A recording at hand, driven by a clock and a disk of the test's own: what is due when, and what a full disk costs."""

from __future__ import annotations

import dataclasses
import errno
import math
import shutil
import types
from unittest import mock

import pytest

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.definitions import Definitions
from mwd_surface.bags.recorder import session as recording_session
from mwd_surface.bags.recorder.session import QueuedMessage, Session, SessionHooks
from mwd_surface.bags.recorder.settings import RecorderSettings
from mwd_surface.bags.recorder.status import EventLevel, RecorderEvent, RecorderState

START = 1_700_000_000_000_000_000
STRING = "std_msgs/msg/String"
EVENTS = "/recorder/events"
LOW = 8_000_000
SETTINGS = RecorderSettings(
    chunk_seconds=1.0, sync_seconds=2.0, split_seconds=60.0, split_bytes=0, min_free_bytes=LOW, retry_seconds=5.0
)


class Bench:
    """A session, with its clock, its disk and what it reported."""

    def __init__(self, folder, monkeypatch, settings=SETTINGS):
        self.now, self.free, self.refused = 100.0, 10 * LOW, 0
        self.given: list[tuple[EventLevel, str]] = []
        clock = types.SimpleNamespace(monotonic=lambda: self.now, time_ns=lambda: START + round(self.now * 1e9))
        monkeypatch.setattr(recording_session, "time", clock)
        definitions = Definitions()
        self.path = folder / "run"
        self.session = Session(
            BagWriter(self.path, definitions, in_place=True, chunk_bytes=settings.chunk_bytes),
            folder,
            settings,
            definitions,
            EVENTS,
            SessionHooks(
                lambda: {"versions": {"at": f"{self.now:.0f}"}}, self._space, lambda: self.refused, self._report
            ),
        )

    def _space(self, folder):
        if not folder.exists():
            raise FileNotFoundError(errno.ENOENT, "No such file or directory", str(folder))
        if isinstance(self.free, OSError):
            raise self.free
        return self.free

    def _report(self, level, text):
        self.given.append((level, text))
        self.session.record(RecorderEvent(START, level, text))

    def take(self, k, topic="/a", log_ns=None, size=300, type_name=STRING, qos=""):
        stamp = START + k * 1_000_000 if log_ns is None else log_ns
        self.session.take(QueuedMessage(topic, type_name, bytes(size), stamp, stamp, qos))

    def later(self, seconds):
        self.now += seconds
        self.session.periodic()

    @property
    def file(self):
        return self.session.writer.file

    def recorded(self):
        """(messages of /a, texts of events, tables of every file) of the finished bag."""
        with Bag(self.path) as bag:
            assert bag.complete
            found = list(bag.messages())
            texts = [bag.decode(EVENTS, data).msg for _, name, _, data in found if name == EVENTS]
            return sum(name == "/a" for _, name, _, _ in found), texts, bag.metadata()


@pytest.fixture
def bench(tmp_path, monkeypatch):
    return Bench(tmp_path, monkeypatch)


def test_a_chunk_reaches_the_file_by_its_age_and_the_disk_by_its_own_time(bench, monkeypatch):
    synced = []
    monkeypatch.setattr(type(bench.file), "sync", lambda file: synced.append(file.size))
    bench.take(0)
    small = bench.file.size
    bench.later(0.9)
    assert (bench.file.size, bench.session.unsaved_since) == (small, 100.0)
    bench.later(0.2)
    assert bench.file.size > small
    assert not synced
    bench.later(1.0)
    assert synced == [bench.file.size]
    assert bench.session.unsaved_since is None


def test_a_message_that_comes_just_before_a_sync_goes_with_it(bench):
    bench.take(0)
    bench.later(1.5)
    bench.now += 0.4
    bench.take(1)
    before = bench.file.size
    bench.later(0.2)
    assert bench.file.size > before
    assert bench.session.unsaved_since is None


@pytest.mark.parametrize("asked", [False, True])
def test_a_new_file_is_begun_by_time_or_if_asked_with_tables_and_topics_of_its_own(bench, asked):
    bench.take(0)
    first = bench.file.path
    if asked:
        bench.now += 61.0
        assert bench.session.split() == first
    else:
        bench.later(61.0)
    assert bench.file.path != first
    bench.take(1)
    bench.session.finish()
    assert bench.recorded()[0] == 2
    for path, at in ((first, "100"), (bench.file.path, "161")):
        with Bag(path) as bag:
            assert bag.complete
            assert bag.topics["/a"].count == 1
            assert dict(bag.metadata())["versions"] == {"at": at}


@pytest.mark.fault_case(43)
@pytest.mark.parametrize("jump_s", [-3600, 3600, 6 * 365 * 86_400])
def test_a_clock_that_jumps_begins_a_new_file_and_says_by_how_much(bench, jump_s):
    bench.take(0)
    bench.take(1, log_ns=START + jump_s * 10**9)
    assert bench.given == [(EventLevel.WARNING, f"the clock jumped by {jump_s:+d} s; a new file was begun")]
    assert bench.file.path.name == "run_1.mcap"
    bench.session.finish()
    assert bench.recorded()[0] == 2


def test_a_disk_about_to_be_full_pauses_with_a_whole_file_and_goes_on_when_there_is_room(bench):
    bench.take(0)
    bench.free = LOW - 1
    bench.later(0.5)
    session = bench.session
    assert (session.state, session.writing) == (RecorderState.PAUSED_DISK_FULL, False)
    assert "8 MB must stay free" in session.reason
    with Bag(bench.path) as bag:
        assert bag.complete
    bench.take(1)
    assert session.dropped == 1
    # A little room is not enough: it would pause again at once.
    bench.free = LOW + 1
    bench.later(10.0)
    assert not session.writing
    bench.free = 2 * LOW
    bench.later(1.0)
    assert (session.state, session.reason) == (RecorderState.RECORDING, "")
    assert bench.given[-1] == (EventLevel.WARNING, "recording goes on after a pause of 11 s; 1 messages were lost")
    bench.take(2)
    session.finish()
    messages, events, _ = bench.recorded()
    assert messages == 2
    assert events[-1].startswith("recording goes on after a pause")


@pytest.mark.fault_case(62)
def test_the_free_space_is_checked_before_a_small_reserve_is_written_full(tmp_path, monkeypatch):
    bench = Bench(tmp_path, monkeypatch, dataclasses.replace(SETTINGS, min_free_bytes=1_000_000, chunk_bytes=10_000))
    for k in range(300):
        bench.free = 1_100_000 - 1000 * k
        bench.take(k, size=1000)
    assert bench.session.state == RecorderState.PAUSED_DISK_FULL
    assert bench.session.free > 800_000


def test_a_pause_is_not_a_jump_of_the_clock(bench):
    """After a minute of a full disk, the recorder said that the clock had jumped by +63 s."""
    bench.take(0)
    bench.free = LOW - 1
    bench.later(0.5)
    bench.free = 10 * LOW
    bench.later(300.0)
    bench.take(1, log_ns=START + round(bench.now * 1e9))
    assert bench.session.writing
    assert not [text for _, text in bench.given if "clock" in text]


@pytest.mark.fault_case(63)
@pytest.mark.parametrize("files", [1, 3])
@pytest.mark.parametrize("noticed", ["check of the disk", "new file", "end"])
@pytest.mark.parametrize("what", ["file", "folder", "all recordings"])
@pytest.mark.parametrize("moved", [False, True])
def test_a_file_that_is_moved_or_deleted_costs_only_deleted_messages_which_are_counted(
    bench, tmp_path_factory, moved, what, noticed, files
):
    for k in range(files):
        if k:
            bench.session.split()
        bench.take(k)
    bench.later(1.0)
    bench.take(files)
    taken = files + 1
    gone = {"file": bench.file.path, "folder": bench.path, "all recordings": bench.path.parent}[what]
    elsewhere = tmp_path_factory.mktemp("elsewhere") / gone.name
    shutil.move(gone, elsewhere)
    if not moved:
        elsewhere.unlink() if elsewhere.is_file() else shutil.rmtree(elsewhere)
    if noticed == "check of the disk":
        bench.later(1.0)
    elif noticed == "new file":
        bench.take(taken, log_ns=START + 10**15)
        taken += 1
    if noticed != "end":
        assert bench.session.state == RecorderState.FAILED
        bench.later(6.0)
        assert bench.session.state == RecorderState.RECORDING
        bench.take(taken)
        taken += 1
    bench.session.finish()
    assert "moved or deleted" in bench.given[0][1]
    here = elsewhere_found = 0
    if list(bench.path.glob("*.mcap")):
        here, events, _ = bench.recorded()
        assert noticed == "end" or any("moved or deleted" in text for text in events)
        with Bag(bench.path) as bag:
            assert bag.notes == []
    for path in [elsewhere] if elsewhere.is_file() else elsewhere.rglob("*.mcap"):
        with Bag(path) as bag:
            assert bag.complete
            elsewhere_found += bag.topics["/a"].count
    assert (elsewhere_found > 0) == moved
    assert here + elsewhere_found + bench.session.lost == taken


@pytest.mark.parametrize("gone", ["folder", "all recordings"])
def test_recording_goes_on_if_its_folder_is_deleted_while_it_is_paused(bench, gone):
    bench.take(0)
    bench.free = LOW - 1
    bench.later(1.0)
    assert not bench.session.writing
    shutil.rmtree(bench.path if gone == "folder" else bench.path.parent)
    bench.free = 10 * LOW
    bench.later(6.0)
    assert bench.session.writing
    bench.take(1)
    bench.session.finish()
    assert bench.recorded()[0] == 1


def test_writing_is_tried_again_no_sooner_than_asked(bench):
    bench.free = LOW - 1
    bench.later(0.5)
    bench.free = 10 * LOW
    bench.later(4.0)
    assert not bench.session.writing
    bench.later(1.5)
    assert bench.session.writing


@pytest.mark.parametrize(
    ("number", "state"), [(errno.ENOSPC, RecorderState.PAUSED_DISK_FULL), (errno.EIO, RecorderState.FAILED)]
)
def test_a_disk_that_refuses_a_write_pauses_as_full_or_failed(bench, number, state):
    bench.take(0)
    with mock.patch.object(BagWriter, "write", side_effect=OSError(number, "no", str(bench.file.path))):
        bench.take(1)
    assert bench.session.state == state
    assert bench.session.reason == f"{bench.file.path}: no"
    assert bench.session.dropped == 1
    bench.later(6.0)
    assert bench.session.state == RecorderState.RECORDING
    bench.session.finish()
    assert bench.recorded()[0] == 1


def test_a_disk_whose_free_space_cannot_be_read_pauses(bench):
    bench.free = OSError(errno.EIO, "no answer")
    bench.later(0.5)
    assert bench.session.state == RecorderState.FAILED
    assert math.isnan(bench.session.free)
    assert bench.session.reason.endswith(": no answer")


def test_one_odd_message_is_counted_and_reported_once_and_the_others_go_on(bench):
    for k in range(3):
        bench.take(k, topic="/odd", log_ns=-1)
        bench.take(k)
    assert bench.session.dropped == 3
    (given,) = bench.given
    assert given[0] == EventLevel.WARNING
    assert "messages of /odd cannot be recorded: its stamp -1 lies before 1970" in given[1]
    bench.session.finish()
    assert bench.recorded()[0] == 3


def test_what_the_queue_did_not_take_is_reported_once_and_counts_as_lost(bench):
    bench.take(0)
    bench.refused = 7
    bench.later(1.0)
    bench.later(1.0)
    assert bench.given == [(EventLevel.ERROR, "7 messages were lost: the disk is slower than the data")]
    assert bench.session.lost == 7


@pytest.mark.fault_case(68)
def test_a_type_or_a_profile_that_is_not_known_is_recorded_and_reported(bench):
    bench.take(0, topic="/new", type_name="nobody_msgs/msg/New")
    bench.take(1, qos="- [")
    assert [text.split(":")[0] for _, text in bench.given] == ["/new", "/a"]
    bench.session.finish()
    with Bag(bench.path) as bag:
        assert {name: about.count for name, about in bag.topics.items() if name != EVENTS} == {"/new": 1, "/a": 1}


def test_an_event_waits_for_the_first_message_whose_time_it_takes(bench):
    bench.session.record(RecorderEvent(START - 10**9, EventLevel.INFO, "begun"))
    bench.take(5)
    bench.session.finish()
    with Bag(bench.path) as bag:
        stamps = {name: log_ns for log_ns, name, _, _ in bag.messages()}
    assert stamps[EVENTS] == stamps["/a"] == START + 5_000_000


def test_a_disk_that_refuses_to_the_last_ends_the_recording_all_the_same(bench, monkeypatch):
    bench.take(0)
    for name in ("close", "finish_file"):
        monkeypatch.setattr(BagWriter, name, mock.Mock(side_effect=OSError(errno.ENOSPC, "full")))
    bench.session.finish()
    assert bench.session.state == RecorderState.PAUSED_DISK_FULL
    # The message, and the word of the pause that went the same way.
    assert bench.session.dropped == 2
    assert any("has no end; the next start recovers it" in text for _, text in bench.given)
