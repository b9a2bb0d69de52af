# SPDX-License-Identifier: Apache-2.0
"""Processes that are kept alive, ended in order and never left behind; real ones, small."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from waiting import eventually

from mwd_sensors.ros import stop_signals
from mwd_surface.runs import supervise
from mwd_surface.runs.supervise import Order, Supervisor

PATIENT = "import signal, sys, time; signal.signal(signal.SIGINT, lambda *_: sys.exit(0)); print('up', flush=True); "
PATIENT += "[time.sleep(0.05) for _ in range(600)]"
DEAF = "import signal, time; [signal.signal(s, signal.SIG_IGN) for s in (signal.SIGINT, signal.SIGTERM)]; "
DEAF += "print('up', flush=True); [time.sleep(0.05) for _ in range(600)]"
PARENT = "import subprocess, sys, time; p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)']); "
PARENT += "print(p.pid, flush=True); time.sleep(60)"


class Clock:
    """Steady seconds that pass when the test says so."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class Watched(Supervisor):
    """A supervisor of processes whose logs are in a folder, by the clock of a test; it keeps what it reports."""

    def __init__(self, folder):
        self.folder, self.time, self.reported = folder, Clock(), []
        super().__init__(os.environ, report=self.reported.append, clock=self.time)

    def run(self, name, code):
        self.start(order(self.folder, name, code))

    def watch_after(self, seconds):
        self.time.now += seconds
        self.watch()

    def watch_the_end(self, name="a"):
        """Wait for the end of a process, and watch."""
        eventually(lambda: not self.runs(name))
        self.watch()


@pytest.fixture
def supervisor(tmp_path):
    made = Watched(tmp_path)
    yield made
    made.kill()


def order(folder, name, code):
    return Order(name, [sys.executable, "-S", "-c", code], folder / f"{name}.log")


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def reported(folder, name, text="up"):
    return lambda: text in (folder / f"{name}.log").read_text()


def test_a_process_that_ends_well_is_done_and_not_started_again(supervisor, tmp_path):
    supervisor.run("a", "print('done')")
    supervisor.watch_the_end()
    supervisor.watch()
    assert supervisor.finished("a")
    assert not supervisor.runs("a")
    assert (tmp_path / "a.log").read_text() == "done\n"


def test_a_crashed_process_is_started_again_after_a_pause_that_doubles(supervisor):
    supervisor.run("a", "import os; os.abort()")
    for pause in (0.5, 1.0, 2.0):
        supervisor.watch_the_end()
        assert supervisor.reported[-1] == f"a ended unexpectedly (killed by SIGABRT); it is restarted in {pause:g} s"
        supervisor.watch_after(pause - 0.01)
        assert not supervisor.runs("a")
        supervisor.watch_after(0.02)
        assert supervisor.reported[-1] == "a is started again"


@pytest.mark.fault_case(57)
def test_a_process_learns_how_many_times_it_was_started_before(supervisor, tmp_path):
    code = "import os; print('start', os.environ['MWD_STARTS'], flush=True); os.abort()"
    supervisor.run("a", code)
    for _ in range(2):
        supervisor.watch_the_end()
        supervisor.watch_after(5.0)
    eventually(lambda: not supervisor.runs("a"))
    assert (tmp_path / "a.log").read_text().splitlines() == ["start 0", "start 1", "start 2"]


def test_a_process_that_cannot_be_started_again_is_tried_slowly(supervisor, tmp_path):
    one = order(tmp_path, "a", "import os; os.abort()")
    supervisor.start(one)
    supervisor.watch_the_end()
    one.log.unlink()
    one.log.mkdir()
    supervisor.watch_after(1.0)
    assert "cannot be started" in supervisor.failing[0]
    one.log.rmdir()
    supervisor.watch_after(31.0)
    assert supervisor.reported[-1] == "a is started again"
    assert one.log.is_file()


@pytest.mark.fault_case(57)
def test_a_process_that_crashes_again_and_again_is_tried_slowly_while_the_others_go_on(supervisor):
    supervisor.run("page", PATIENT)
    supervisor.run("a", "import sys; print('no such sensor'); sys.exit(7)")
    for _ in range(5):
        supervisor.watch_the_end()
        supervisor.watch_after(20.0)
    supervisor.watch_the_end()
    assert supervisor.failing == ["a crashed 6 times in a row (status 7): no such sensor"]
    assert "tried every 30 s" in supervisor.reported[-1]
    supervisor.watch_after(29.0)
    assert not supervisor.runs("a")
    supervisor.watch_after(2.0)
    assert supervisor.reported[-1] == "a is started again"
    supervisor.watch_the_end()
    assert supervisor.runs("page")


def test_a_failing_process_that_stays_alive_is_well_again(supervisor, tmp_path):
    words = f"import os, sys; sys.exit(2) if not os.path.exists('{tmp_path}/now') else None; {PATIENT}"
    supervisor.run("a", words)
    supervisor.watch_the_end()
    assert supervisor.failing
    (tmp_path / "now").touch()
    supervisor.watch_after(31.0)
    eventually(reported(tmp_path, "a"))
    supervisor.watch_after(21.0)
    assert not supervisor.failing
    assert supervisor.reported[-1] == "a has recovered"


def test_refused_settings_are_named(supervisor):
    supervisor.run("a", "import sys; print('rate: must be above 0'); sys.exit(2)")
    supervisor.watch_the_end()
    assert supervisor.failing == ["a does not start: rate: must be above 0"]


def test_processes_end_by_request_and_in_order(supervisor, tmp_path):
    for name in ("a", "b"):
        supervisor.run(name, PATIENT)
    eventually(reported(tmp_path, "a"))
    eventually(reported(tmp_path, "b"))
    assert supervisor.stop([["b"], ["a"]]) == []
    assert not supervisor.runs("a")
    assert not supervisor.runs("b")
    supervisor.watch()
    assert not supervisor.runs("a")


def test_a_node_that_hangs_has_time_to_end_itself():
    assert supervise._MARGIN > stop_signals._LOCK_PATIENCE


def test_a_process_that_waits_for_a_processor_is_not_killed(supervisor, tmp_path):
    pinned = f"import os; os.sched_setaffinity(0, {{{min(os.sched_getaffinity(0))}}})\n"
    # Ends in order after .6 s of its processor, which another process of the same priority uses too.
    working = "import signal, sys, time\nsignal.signal(signal.SIGINT, lambda *_: None)\nprint('up', flush=True)\n"
    working += "signal.pause()\nuntil = time.thread_time() + 0.6\nwhile time.thread_time() < until: pass"
    for name, code in (("a", pinned + working), ("rival", pinned + "print('up', flush=True)\nwhile True: pass")):
        supervisor.run(name, code)
        eventually(reported(tmp_path, name))
    began = time.monotonic()
    assert supervisor.stop([["a"]], patience=0.8) == []
    assert time.monotonic() - began > 0.8


def test_a_deaf_process_is_killed_and_named(supervisor, tmp_path, monkeypatch):
    monkeypatch.setattr(supervise, "_TERM_PATIENCE", 0.1)
    supervisor.run("a", DEAF)
    eventually(reported(tmp_path, "a"))
    assert supervisor.stop([["a"]], patience=0.1) == ["a"]
    assert not supervisor.runs("a")


@pytest.mark.fault_case(70)
def test_the_log_of_a_process_that_writes_for_ever_is_bounded_and_its_end_is_kept(supervisor, tmp_path, monkeypatch):
    monkeypatch.setattr(supervise, "_MOST_LOG", 100_000)
    log = tmp_path / "a.log"
    supervisor.run("a", "import itertools\nfor k in itertools.count(): print(f'line {k:8d}', flush=True)")
    before = log.with_name("a.1.log")
    for _ in range(3):
        eventually(lambda: log.stat().st_size > 100_000)
        supervisor.watch()
        assert before.stat().st_size > 100_000
        # Lines that were under way when the log was cut are all that is lost.
        eventually(lambda: log.stat().st_size > 10_000)
        lines = [int(line.split()[1]) for line in log.read_text().splitlines()[1:-1]]
        assert lines == list(range(lines[0], lines[0] + len(lines)))
    supervisor.kill()
    assert {path.name for path in tmp_path.iterdir()} == {"a.log", "a.1.log"}


@pytest.mark.parametrize("crashed", [False, True])
def test_what_a_process_started_ends_with_it(supervisor, tmp_path, crashed):
    supervisor.run("a", PARENT)
    eventually(reported(tmp_path, "a", "\n"))
    grandchild = int((tmp_path / "a.log").read_text())
    assert alive(grandchild)
    if crashed:
        os.kill(supervisor._children["a"].process.pid, signal.SIGKILL)
        supervisor.watch_the_end()
    else:
        supervisor.stop([["a"]])
    eventually(lambda: not alive(grandchild))


def test_a_process_does_not_outlive_a_killed_supervisor(tmp_path):
    child = "import os, time; from mwd_surface.runs.supervise import die_with_supervisor; "
    child += "die_with_supervisor(os.environ); print('up', flush=True); time.sleep(60)"
    parent = (
        "import os, pathlib, sys, time\n"
        "from mwd_surface.runs.supervise import Order, Supervisor\n"
        "supervisor = Supervisor(os.environ)\n"
        f"supervisor.start(Order('a', [sys.executable, '-c', {child!r}], pathlib.Path({str(tmp_path / 'a.log')!r})))\n"
        "print(supervisor._children['a'].process.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True) as process:
        pid = int(process.stdout.readline())
        eventually((tmp_path / "a.log").exists)
        eventually(reported(tmp_path, "a"))
        process.kill()
    eventually(lambda: not alive(pid))


def test_a_name_is_used_once_at_a_time(supervisor):
    supervisor.run("a", PATIENT)
    with pytest.raises(ValueError, match="a runs already"):
        supervisor.run("a", PATIENT)


def test_the_last_words_of_a_log_are_found(tmp_path):
    log = tmp_path / "a.log"
    assert "cannot be read" in supervise.last_words(log)
    log.write_text("\n\n")
    assert "no output" in supervise.last_words(log)
    log.write_text("first\n  the last one  \n\n")
    assert supervise.last_words(log) == "the last one"
    assert supervise.in_words(-9) == "killed by SIGKILL"
    assert supervise.in_words(-250) == "killed by signal 250"
