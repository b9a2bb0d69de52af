# SPDX-License-Identifier: Apache-2.0
"""Parts of the well's state that are also messages: a round trip through the message changes no value."""

import dataclasses
import enum
import math
import typing

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy", reason="ROS is not installed for this Python")
pytest.importorskip("mwd_msgs.msg", reason="mwd_msgs is not built")

from mwd_msgs import msg

from mwd_sensors.ros.messages import make
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.control.set_point import LeaseLimits
from mwd_surface.control.status import Achieved, ControlStatus, Reaction
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.live.alarms import Alarm, Event
from mwd_surface.live.inputs import InputState, InputTable, StampClock
from mwd_surface.live.link_state import LinkFrameState, LinkStatus, LinkWordState
from mwd_surface.trajectory.advice import Advice

# Fields of messages that the state does not hold: they name the link, or are of use to the estimator only.
NOT_KEPT = {
    LinkWordState: {"measured", "link", "bits", "raw"},
    LinkFrameState: {"link", "complete", "clock_error"},
    LinkStatus: {"latency", "pump_lines", "frame"},
    RecorderStatus: {"streams", "first"},
}
WHOLE = (InputState, InputTable, Alarm, Event, Advice, DownlinkStatus, LinkWordState, LinkFrameState, LinkStatus)
NUMBERS = st.floats(allow_infinity=False, width=64)
# Fields of ControlStatus that the message splits into several fields.
OF_CONTROL = {
    "limits": st.builds(LeaseLimits, *[st.floats(0.0, 1e3)] * len(dataclasses.fields(LeaseLimits))),
    "achieved": st.builds(Achieved, *[st.none() | st.floats(-1e3, 1e3)] * len(dataclasses.fields(Achieved))),
    "reactions": st.fixed_dictionaries(
        {
            f"{who}_lost_{how}": st.sampled_from(Reaction)
            for who in ("controller", "mwd")
            for how in ("sliding", "rotating")
        }
    ),
}


def anything(kind, name=""):
    """Return a strategy for any value of a type that a message can hold."""
    if typing.get_origin(kind) is tuple:
        return st.lists(anything(typing.get_args(kind)[0]), max_size=3).map(tuple)
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return st.sampled_from(kind)
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        return st.builds(kind, **{one: anything(hints[one], one) for one in kind.sent()})
    whole = st.integers(0, 2 * 10**18 if name.endswith("_ns") else 255)
    return {float: NUMBERS, int: whole, bool: st.booleans(), str: st.text("aß°", max_size=3)}[kind]


@pytest.mark.parametrize("kind", [*WHOLE, RecorderStatus])
@given(data=st.data())
def test_a_part_goes_there_and_back_unchanged(kind, data):
    part = data.draw(anything(kind))
    assert kind.from_message(part.to_message(make)) == part


@given(anything(ControlStatus), st.fixed_dictionaries(OF_CONTROL))
def test_control_goes_there_and_back_with_every_limit(status, more):
    status = dataclasses.replace(status, **more)
    assert ControlStatus.from_message(status.to_message(make)) == status


@pytest.mark.parametrize("kind", [*WHOLE, RecorderStatus])
def test_a_part_holds_every_field_of_its_message(kind):
    theirs = set(getattr(msg, kind.MESSAGE.rpartition("/")[2]).get_fields_and_field_types()) - {"header"}
    ours = {name.removesuffix("_ns") for name in kind.sent() if name != "stamp_ns"}
    assert ours == theirs - NOT_KEPT.get(kind, set())


def test_a_message_that_says_nothing_leaves_unknown_numbers_unknown():
    again = InputTable.from_message(InputTable((InputState("sonde", StampClock.TOOL),)).to_message(make))
    assert math.isnan(again.depth_age)
    assert math.isnan(again.inputs[0].bit_depth)
