# SPDX-License-Identifier: Apache-2.0
"""The log of protocol libraries is bounded, whatever a peer sends."""

import logging

from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.rig.interface import LibraryLog


def logged(messages, step_s=0.0):
    now, lines = [1000.0], []
    handler = LibraryLog(lines.append, lambda: now[0])
    for message in messages:
        error = ValueError(message)
        record = logging.LogRecord("lib", logging.ERROR, "", 0, "%s", (message,), (ValueError, error, None))
        handler.emit(record)
        now[0] += step_s
    return lines


@given(st.lists(st.text(max_size=2000), max_size=60))
def test_a_flood_of_any_messages_gives_few_short_plain_lines(messages):
    lines = logged(messages)
    assert len(lines) <= 10
    assert all(len(line) < 1000 and "\n" not in line and "\x1b" not in line for line in lines)


def test_how_many_were_left_out_is_said_when_the_next_minute_begins():
    lines = logged(["junk"] * 100, step_s=1.0)
    assert "lib: 50 more messages were left out" in lines
    assert sum("junk" in line for line in lines) == 20
