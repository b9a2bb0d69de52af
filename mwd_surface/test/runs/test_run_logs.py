# SPDX-License-Identifier: Apache-2.0
"""Logs and health of a recording: found in a recording without rig data, and read only for reports."""

import math

import example_surveys as example
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from plotted_bag import recorded
from typer.testing import CliRunner

from mwd_sensors.core.message_record import time_message
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.cli import app
from mwd_surface.exports.export import FORMATS
from mwd_surface.live.inputs import HAND, InputState, InputTable, Role, StampClock
from mwd_surface.runs import player as module
from mwd_surface.runs.player import recorded_book, run_logs

S = 10**9
T0 = 1_772_323_200 * S


def inputs(at, bit_depth, make):
    """The list of inputs at a moment, s, at which a person sets a depth, m (NaN: nobody does)."""
    row = InputState(HAND, StampClock.HOST, 0.0, 0.0, 0.0, Role.IN_FORCE, 1, bit_depth)
    message = InputTable(() if math.isnan(bit_depth) else (row,), HAND, 0.0).to_message(make)
    message.header.stamp = time_message(T0 + at * S, make)
    return message


def without_rig(path, namespace, depths, log=""):
    """Write a recording that has depths by hand, one every 10 s, and log samples of the topic `log`."""
    with BagWriter(path) as out:
        store = out.definitions.typestore

        def write(topic, type_name, at, message):
            out.write(topics[topic], bytes(store.serialize_cdr(message, type_name)), T0 + at * S)

        topics = {"inputs": out.topic(f"{namespace}inputs", InputTable.MESSAGE)} if depths else {}
        if log:
            topics[log] = out.topic(f"{namespace}{log}", LogSample.MESSAGE)
        for at in range(0, 10 * max(len(depths), 6), 10):
            if at < 10 * len(depths):
                write("inputs", InputTable.MESSAGE, at, inputs(at, depths[at // 10], out.definitions.make))
            if log:
                sample = LogSample(T0 + at * S, "battery_voltage", "V", 1.0, 1.0, 27.5, 0.1, source="battery_voltage")
                write(log, LogSample.MESSAGE, at, sample.to_message(out.definitions.make))
    return path


@settings(max_examples=12, deadline=None)
@given(
    namespace=st.sampled_from(("/", "/w1/", "/mine/h7/")),
    depths=st.one_of(st.just([]), st.lists(st.floats(3.0, 900.0), min_size=2, max_size=4)),
    log=st.sampled_from(("", "log", "link/log")),
)
def test_a_recording_without_rig_data_has_the_depths_by_hand_and_the_health_of_its_tool(
    tmp_path_factory, namespace, depths, log
):
    assume(depths or log)
    path = without_rig(tmp_path_factory.mktemp("rods") / "bag", namespace, depths, log)
    found = run_logs(path, 0.0)
    assert found is not None
    if log:
        assert found[1].battery.voltage == pytest.approx(27.5)
    with Bag(path) as bag:
        if not depths:
            with pytest.raises(BagError, match="depth set by hand"):
                recorded_book(bag)
            return
        book = recorded_book(bag)
        for k, depth in enumerate(depths):
            reading = book.depth.sensor_depth(T0 + 10 * k * S + S, 0.0)
            assert reading.by_hand
            assert reading.measured_depth == pytest.approx(depth)


def test_inputs_that_give_no_depth_are_not_a_depth(tmp_path):
    path = without_rig(tmp_path / "bag", "/w1/", [math.nan, math.nan], "log")
    with Bag(path) as bag, pytest.raises(BagError, match="no depth of the bit"):
        recorded_book(bag)


class PlayedError(Exception):
    """Raised where a recording would be played."""


@pytest.mark.parametrize("kind", FORMATS)
def test_only_a_report_plays_the_recording(tmp_path, monkeypatch, kind):
    bag = recorded(tmp_path / "bag", [example.surveys()])

    def play(*args):
        raise PlayedError

    monkeypatch.setattr(module, "run_logs", play)
    done = CliRunner().invoke(app, ["export", str(bag), "-f", kind, "-o", str(tmp_path)])
    # The report itself is not drawn here.
    if kind in ("html", "pdf", "xlsx"):
        assert isinstance(done.exception, PlayedError)
    else:
        assert done.exit_code == 0, done.output
