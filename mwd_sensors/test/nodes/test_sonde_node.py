# SPDX-License-Identifier: Apache-2.0
"""What the simulated sonde does on a machine that is too slow for it."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from mwd_sensors.nodes import sonde as module
from mwd_sensors.nodes.sonde import SondeNode, SondeSettings


def test_a_simulation_slower_than_its_rate_drops_behind_and_says_so(monkeypatch):
    now, said = [100.0], []
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])

    def simulate(_sonde):
        # A block of a tenth of a second takes a second.
        now[0] += 1.0
        node._simulated_until += 0.1

    node = SimpleNamespace(
        _sonde=SimpleNamespace(duration=600.0),
        _finished=False,
        settings=SondeSettings(rate=1.0),
        _started_at=100.0,
        _dropped_s=0.0,
        _simulated_until=0.0,
        _all_simulated=False,
        _pending=[],
        _telemetry=None,
        _published={},
        _simulate_block=simulate,
        _publish_due=lambda _until: None,
        get_logger=lambda: SimpleNamespace(warning=lambda text, **_: said.append(text)),
    )
    for call in range(1, 21):
        SondeNode._on_timer(node)
        # One block a call: signals and requests are heard in between.
        assert node._simulated_until == pytest.approx(0.1 * call)
        assert (now[0] - node._started_at) - node._simulated_until < 3.0
    assert "cannot simulate at rate 1" in said[-1]
    shown = SondeNode._progress_diagnostic(node)
    assert shown.message.endswith(" s behind the clock")
    assert float(shown.message.split()[0]) == pytest.approx(18.0, abs=0.2)
    assert "lower the rate" in shown.remedy
