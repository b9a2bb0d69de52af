# SPDX-License-Identifier: Apache-2.0
"""What the simulated sonde does on a machine that is too slow for it."""

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
        now=now, block_s=block_s, message_s=message_s,
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
