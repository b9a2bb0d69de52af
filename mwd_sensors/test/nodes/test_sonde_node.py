# SPDX-License-Identifier: Apache-2.0
"""The node of the simulated sonde on a machine that is too slow for it, and with a clock that stops or goes back."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from mwd_sensors.nodes import sonde as module
from mwd_sensors.nodes.sonde import SondeNode, SondeSettings

_PER_BLOCK = 40  # messages


class Slow(SimpleNamespace):
    """A node on a machine that needs some time for each simulated block and for each published message, s."""

    _on_timer, _publish_due = SondeNode._on_timer, SondeNode._publish_due
    _progress_diagnostic = SondeNode._progress_diagnostic

    def _simulate_block(self, _sonde):
        self.now[0] += self.block_s
        begin = self._simulated_until
        self._pending += [(begin + 0.1 * k / _PER_BLOCK, 0, "imu", b"") for k in range(_PER_BLOCK)]
        self._simulated_until += 0.1

    def publish(self, _message):
        self.now[0] += self.message_s


@pytest.mark.parametrize("rate", [0.0, 0.5, 1.0, 10.0])
@pytest.mark.parametrize(("block_s", "message_s"), [(1.0, 0.0), (0.001, 0.01), (0.05, 0.002), (0.0001, 0.0001)])
def test_a_sonde_slower_than_its_rate_drops_behind_says_so_and_keeps_no_more_messages(
    rate, block_s, message_s, monkeypatch
):
    now, said = [100.0], []
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    node = Slow(
        now=now, block_s=block_s, message_s=message_s, _now=lambda: now[0], _latest=100.0,
        _sonde=SimpleNamespace(duration=6000.0), _finished=False, settings=SondeSettings(rate=rate),
        _started_at=100.0, _dropped_s=0.0, _simulated_until=0.0, _all_simulated=False, _block_s=0.1,
        _pending=[], _telemetry=None, _published={},
        get_logger=lambda: SimpleNamespace(warning=lambda text, **_: said.append(text)),
    )  # fmt: skip
    node._topic_publishers = {"imu": node}
    # What is simulated in the longest lag that is caught up, and in two blocks.
    most = _PER_BLOCK * (10.0 * module._MOST_BEHIND_S * max(rate, 1.0) + 2.0)
    for _ in range(3000):
        node._on_timer()
        assert len(node._pending) <= most
        now[0] += 0.005
    needed = block_s + _PER_BLOCK * message_s
    # It goes on, at half the speed that the machine allows or at what was asked for; the timer calls every 5 ms.
    assert node._simulated_until > 0.5 * (now[0] - 100.0) * 0.1 / max(needed + 0.005, 0.1 / rate if rate else 0.0)
    if rate and needed > 1.1 * 0.1 / rate:
        assert f"cannot simulate at rate {rate:g}" in said[-1]
        shown, behind = node._progress_diagnostic(), (now[0] - 100.0) - node._simulated_until / rate
        assert shown.message == f"{behind:.1f} s behind the clock"
        assert "lower the rate" in shown.remedy
    elif rate and needed < 0.5 * 0.1 / rate:
        assert not said


class Followed(SimpleNamespace):
    """A node in simulated time, which stands at `now`, s; the simulation takes no time."""

    _on_timer, _publish_due, _now = SondeNode._on_timer, SondeNode._publish_due, SondeNode._now

    def get_parameter(self, name):
        return SimpleNamespace(value=name == "use_sim_time")

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=round(self.now * 1e9)))

    def get_logger(self):
        return SimpleNamespace(warning=lambda *_, **__: None)

    def _awaits_node(self):
        return False

    def _start(self):
        self._started_at = self._latest = self._now()
        self._simulated_until, self._pending = 0.0, []
        self.starts.append(self.now)
        self._sonde = SimpleNamespace(duration=6000.0)
        return self._sonde

    def _simulate_block(self, _sonde):
        begin = self._simulated_until
        self._pending += [(begin + 0.01 * k, 0, "imu", b"") for k in range(10)]
        self._simulated_until += 0.1

    def publish(self, _message):
        self.published += 1


def test_a_sonde_in_simulated_time_is_as_fast_as_the_clock_stops_with_it_and_starts_again_if_it_goes_back():
    node = Followed(
        now=0.0, starts=[], published=0, _sonde=None, _finished=False, settings=SondeSettings(), _dropped_s=0.0,
        _all_simulated=False, _block_s=0.1, _telemetry=None, _published={},
        _discovery=SimpleNamespace(complete=lambda *_: True),
    )  # fmt: skip
    node._topic_publishers = {"imu": node}

    def advance(steps, step_s):
        before = node.published
        for _ in range(steps):
            node.now += step_s
            node._on_timer()
        return node.published - before

    # No clock message yet.
    assert advance(100, 0.0) == 0
    assert advance(100, 0.05) == pytest.approx(500, abs=10)
    # The clock stops, and goes on five times as slowly.
    assert advance(1000, 0.0) == 0
    assert advance(100, 0.01) == pytest.approx(100, abs=10)
    assert len(node.starts) == 1
    node.now -= 3.0
    node._on_timer()
    assert advance(100, 0.01) == pytest.approx(100, abs=10)
    assert node.starts[1:] == [pytest.approx(3.0, abs=0.2)]
