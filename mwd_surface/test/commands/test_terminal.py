# SPDX-License-Identifier: Apache-2.0
"""What a terminal shows of long work, and that a file of remarks stays free of it."""

import io
import os
import pty
import re
import threading

import pytest

from mwd_surface.commands import terminal


@pytest.mark.fault_case(67)
def test_long_work_shows_its_share_and_the_time_left(monkeypatch):
    ours, theirs = pty.openpty()
    shown = io.BytesIO()

    def take():
        # The far end of a terminal that was closed gives an error, not an end.
        try:
            while piece := os.read(ours, 4096):
                shown.write(piece)
        except OSError:
            return

    reader = threading.Thread(target=take)
    reader.start()
    with os.fdopen(theirs, "w") as screen:
        monkeypatch.setattr("sys.stderr", screen)
        monkeypatch.setenv("TERM", "xterm")
        with terminal.progress("processing run_7") as set_share:
            share = 0.0
            while not re.search(rb"\d+%.*\d:\d\d:\d\d", shown.getvalue()) and share < 0.99:
                share += 0.0001
                set_share(share)
                threading.Event().wait(0.005)
    reader.join()
    os.close(ours)
    assert b"processing run_7" in shown.getvalue()
    assert re.search(rb"\d+%.*\d:\d\d:\d\d", shown.getvalue())


def test_where_there_is_no_terminal_nothing_is_shown(monkeypatch):
    remarks = io.StringIO()
    monkeypatch.setattr("sys.stderr", remarks)
    with terminal.progress("processing run_7") as set_share:
        set_share(0.5)
    assert remarks.getvalue() == ""
