# SPDX-License-Identifier: Apache-2.0
"""An echo proves that a command arrived only where the tool could not have sent it before."""

from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.telemetry.downlink import COUNTERS, DownlinkFrame
from mwd_surface.downlink.tool_echo import ToolEcho

PROGRAMME_S, ANSWER_S = 200.0, 300.0


class Story:
    """A tool that receives some of the commands, and a surface that hears some of the echoes, late but in order."""

    def __init__(self):
        self.now, self.echo, self.counter = 1000.0, ToolEcho(), 0
        self.obeyed = [(0.0, 0, None)]  # when, code, number of the attempt
        self.on_air = 0.0
        self.attempt, self.asked, self.proves = 0, None, False

    def send(self, command, complete, received):
        """Send a command; one that is aborted is not received."""
        self.asked, self.proves = self.echo.numbered(DownlinkFrame(1, command, 0), self.counter)
        self.counter, self.attempt = self.asked.counter, self.attempt + 1
        self.echo.send(self.asked.echo, self.now + PROGRAMME_S + ANSWER_S)
        self.now += PROGRAMME_S if complete else 20.0
        if complete and received and self.asked.echo != self.obeyed[-1][1]:
            self.obeyed.append((self.now, self.asked.echo, self.attempt))

    def hear(self, delay):
        """Hear the word that the tool sent a while ago."""
        self.on_air = max(self.on_air, self.now - delay)
        _, code, attempt = [one for one in self.obeyed if one[0] <= self.on_air][-1]
        self.echo.hear(code, self.now, ANSWER_S)
        if self.asked is not None and self.proves and code == self.asked.echo:
            assert attempt == self.attempt

    def restart(self, lost):
        """Start the surface again, perhaps without its memory; whoever asked before waits no more."""
        self.echo = ToolEcho() if lost else ToolEcho(self.echo.heard, self.echo.sent)
        self.counter = 0 if lost else self.counter
        self.asked = None


STEPS = st.one_of(
    st.tuples(st.just("send"), st.tuples(st.integers(0, 1), st.booleans(), st.booleans())),
    st.tuples(st.just("hear"), st.tuples(st.sampled_from([0.0, 60.0, 299.0]))),
    st.tuples(st.just("restart"), st.tuples(st.booleans())),
    st.tuples(st.just("wait"), st.tuples(st.sampled_from([30.0, 600.0]))),
)


@given(st.lists(STEPS, max_size=40))
def test_a_proof_is_never_an_echo_of_an_earlier_command(steps):
    story = Story()
    for name, arguments in steps:
        if name == "wait":
            story.now += arguments[0]
        else:
            getattr(story, name)(*arguments)


def test_whoever_hears_the_tool_can_always_be_certain_of_the_next_command():
    story = Story()
    for k in range(5 * COUNTERS):
        story.hear(0.0)
        story.send(1, complete=True, received=k % 3 != 0)
        assert story.proves
        story.now += ANSWER_S + 1.0


def test_without_any_echo_nothing_is_proved_and_the_counters_still_go_round():
    story = Story()
    for _ in range(2 * COUNTERS):
        story.send(1, complete=True, received=True)
        assert not story.proves
    assert len({code for _, code, _ in story.obeyed}) == COUNTERS
