# SPDX-License-Identifier: Apache-2.0
"""`mwd downlink state` and `watch` of a topic that repeats its history to each new subscriber."""

import contextlib

import pytest
from typer.testing import CliRunner

from mwd_surface.commands import downlink


def message(number, word, reason="said"):
    state = downlink._STATES.index(word)
    return {"number": number, "state": state, "reason": reason, "symbol": 1, "symbols": 9, "blocked_by": []}


class Client:
    """A graph whose topic has a history; what comes later is heard by the next subscription, after some in silence."""

    def __init__(self, history, later, silences):
        self._visits = [[]] * silences + [history, history + later]

    def listen(self, topic, _seconds):
        assert topic == "downlink/state"
        return iter([(0.0, one) for one in self._visits.pop(0)])


def run(monkeypatch, words, history, later=(), silences=0):
    client = Client(list(history), list(later), silences)
    monkeypatch.setattr(downlink, "visit", lambda _: contextlib.nullcontext(client))
    return CliRunner().invoke(downlink.downlink, words.split())


@pytest.mark.parametrize(("end", "status"), [("confirmed", 0), ("unconfirmed", 1), ("denied", 1)])
def test_watch_follows_the_newest_command_and_no_earlier_one(monkeypatch, end, status):
    history = [message(2, "aborted"), message(3, "granted"), message(3, "running")]
    got = run(monkeypatch, "watch", history, [message(3, "sent"), message(3, end)])
    assert got.exit_code == status
    assert [line.split(":")[0] for line in got.output.splitlines()] == [
        "3 granted",
        "3 running, symbol 1 of 9",
        "3 sent",
        f"3 {end}",
    ]


@pytest.mark.parametrize(("end", "status"), [("confirmed", 0), ("aborted", 1)])
def test_watch_says_how_the_newest_command_has_ended(monkeypatch, end, status):
    got = run(monkeypatch, "watch", [message(2, "aborted"), message(3, "running"), message(3, end)])
    assert (got.exit_code, got.output) == (status, f"3 {end}: said\n")


def test_watch_listens_for_as_long_as_it_is_asked_to(monkeypatch):
    got = run(monkeypatch, "watch --seconds 8", [message(3, "confirmed")], silences=2)
    assert (got.exit_code, got.output) == (0, "3 confirmed: said\n")
    silent = run(monkeypatch, "watch --seconds 8", [], silences=2)
    assert str(silent.exception).startswith("no downlink state received within 8 s")


def test_state_is_the_newest_and_silence_has_two_causes(monkeypatch):
    assert run(monkeypatch, "state", [message(1, "denied"), message(2, "sent")]).output == "2 sent: said\n"
    silent = run(monkeypatch, "state", [])
    assert isinstance(silent.exception, ValueError)
    assert "the machine is busy, or the surface node has no downlink" in str(silent.exception)
