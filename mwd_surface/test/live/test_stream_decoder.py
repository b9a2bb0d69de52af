# SPDX-License-Identifier: Apache-2.0
"""What the surface makes of a topic that two sources publish, and of messages that are none."""

from types import SimpleNamespace

import pytest

from mwd_sensors.core import wire
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.source_selection import SourceRules, SourceSelection
from mwd_surface.live.stream_decoder import StreamDecoder


def decoder():
    got, log, warned = [], AlarmLog(lambda: 0), []
    seen = {}

    def take(samples):
        got.extend(samples["bit_depth"])
        return samples

    context = SimpleNamespace(live=LiveState(), alarm_log=log, outlet=SimpleNamespace(warn=warned.append))
    made = StreamDecoder(
        context,
        SourceSelection(SourceRules()),
        on_attitude=lambda _samples: None,
        on_rig_state=take,
        on_sonde=lambda _samples: None,
        on_rig_input=lambda frame, samples: seen.setdefault(frame, []).extend(samples["bit_depth"]),
    )
    made.seen = seen
    return made, got, log, warned


def rig_state(depth, frame, stamp_ns):
    samples = wire.RIG_STATE.empty(1)
    samples["bit_depth"], samples["stamp_ns"] = depth, stamp_ns
    return wire.RIG_STATE.encode(samples, frame)[0].tobytes()


@pytest.mark.fault_case(53)
@pytest.mark.parametrize("other", ["rig_floor_2", "wits_in_", "x"])
def test_a_second_writer_of_the_rig_state_is_named_and_not_used(other):
    made, got, log, _ = decoder()
    for k in range(20):
        both = [rig_state(1000.0 + k, "rig_floor", k), rig_state(10.0, other, k)]
        made.buffers["rig/state"] += both if k == 0 else both[::-1]
        made.decode_all(0.05 * k)
    made.update(1.0)
    assert got == [1000.0 + k for k in range(20)]
    (alarm,) = log.alarms()
    assert other in alarm.text
    assert "rig_floor is used" in alarm.text
    made.update(100.0)
    assert not any(alarm.active for alarm in log.alarms())


def test_every_source_of_rig_data_is_heard_and_one_that_has_its_place_is_no_alarm():
    made, got, log, _ = decoder()
    for k in range(20):
        made.buffers["rig/state"] += [
            rig_state(10.0, "w/rig_wits", 2 * k),
            rig_state(1000.0 + k, "w/rig_floor", 2 * k + 1),
        ]
        made.decode_all(float(k))
    made.update(20.0)
    assert made.seen == {"w/rig_wits": [10.0] * 20, "w/rig_floor": [1000.0 + k for k in range(20)]}
    # In one block with the best source from the start: it is used at once.
    assert got == made.seen["w/rig_floor"]
    assert not log.alarms()


@pytest.mark.fault_case(66)
def test_a_message_that_is_none_costs_only_itself():
    made, got, log, _ = decoder()
    made.buffers["rig/state"] += [rig_state(1.0, "rig_floor", 1), b"\x00\x01\x00\x00", rig_state(2.0, "rig_floor", 2)]
    made.decode_all(0.0)
    assert got == [1.0, 2.0]
    made.update(0.0)
    assert made.unreadable == 1
    assert not log.alarms()
