# SPDX-License-Identifier: Apache-2.0
"""A polled line: both ends agree, damaged frames are refused, and each fault of the line is named."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.drivers import polled_line
from mwd_sensors.drivers.polled_line import FORMS, Master, Poll, PolledFrame, PolledLineUnit, ReplyItem

ANGLES = Poll(3, "0000 0003", tuple(ReplyItem(name, "uint16", 0.01, unit="deg") for name in ("inc", "azi", "tf")))
FRAME = PolledFrame(polls=(ANGLES,), timeout_s=0.1, period_s=0.5, retries=2)
VALUES = {"inc": math.radians(84.5), "azi": math.radians(159.42), "tf": math.radians(359.99)}
HALF = PolledFrame(start="eb90", counted=False, byte_order="little", check_order="high_first", polls=(ANGLES,))


def asked(frame=FRAME, now=0.0):
    """A master whose first request is on the line, and the bytes of a right reply."""
    master = Master(frame)
    assert master.due(now) == polled_line.request(frame, frame.polls[0])
    return master, polled_line.reply(frame, frame.polls[0], VALUES)


def given_up(master, now=10.0):
    """Let the wait for a reply end, and return all sentences."""
    master.due(now)
    return list(master.trouble)


def test_a_request_and_its_check_are_those_of_the_modbus_specification():
    # Reading register 0x6B of unit 0x11 (function 3, three registers): a published frame, check 76 87.
    frame = PolledFrame(address=0x11, polls=(Poll(3, "006b 0003", (ReplyItem("a", "uint16"),)),))
    assert polled_line.request(frame, frame.polls[0]).hex(" ") == "11 03 00 6b 00 03 76 87"
    turned = dataclasses.replace(frame, check_order="high_first")
    assert polled_line.request(turned, turned.polls[0]).hex(" ").endswith("87 76")


@pytest.mark.parametrize("frame", [FRAME, HALF, dataclasses.replace(FRAME, byte_order="swapped")])
def test_the_master_reads_the_numbers_that_the_unit_sent(frame):
    master, _ = asked(frame)
    unit = PolledLineUnit(frame)
    poll = unit.feed(polled_line.request(frame, ANGLES))
    (got,) = master.feed(polled_line.reply(frame, poll, VALUES), 0.02)
    assert got.values == pytest.approx(VALUES, abs=math.radians(0.006))
    assert got.sent_s == 0.0
    assert (master.trouble, unit.trouble) == ({}, {})


@given(st.sampled_from(sorted(FORMS)), st.sampled_from(["big", "little", "swapped"]), st.data())
def test_every_form_and_order_reads_back_what_was_written(form, order, data):
    number = data.draw(
        st.floats(-1e6, 1e6, width=32)
        if form.startswith("float")
        else st.integers(*polled_line._limits(form)[:2]).filter(lambda n: abs(n) < 2**53)
    )
    frame = PolledFrame(byte_order=order, polls=(Poll(4, "", (ReplyItem("v", form), ReplyItem("nothing", form))),))
    (got,) = asked(frame)[0].feed(polled_line.reply(frame, frame.polls[0], {"v": float(number)}), 0.0)
    assert got.values["v"] == number
    assert math.isnan(got.values["nothing"])


def test_a_time_in_nanoseconds_keeps_its_last_digit_and_a_dip_is_an_inclination_from_the_horizontal():
    poll = Poll(4, "", (ReplyItem("time", "int64", 1e-9), ReplyItem("inclination", "int16", -0.01, 90.0, "deg")))
    frame = PolledFrame(polls=(poll,))
    sent = {"time": 1_772_344_800_123_456_789, "inclination": math.radians(70.26)}
    data = polled_line.reply(frame, poll, sent)
    assert int.from_bytes(data[-4:-2], "big", signed=True) == 1974  # 19.74 deg
    (got,) = asked(frame)[0].feed(data, 0.0)
    assert got.values["time"] == sent["time"]
    assert got.values["inclination"] == pytest.approx(sent["inclination"])


def test_a_value_that_is_missing_or_beyond_its_form_is_sent_as_unknown():
    data = polled_line.reply(FRAME, ANGLES, {"inc": math.nan, "azi": math.radians(700.0)})
    (got,) = asked()[0].feed(data, 0.0)
    assert all(math.isnan(value) for value in got.values.values())


@pytest.mark.parametrize("frame", [FRAME, HALF])
def test_a_reply_with_any_single_bit_flipped_gives_no_numbers_and_a_flipped_request_no_answer(frame):
    _, right = asked(frame)
    whole = polled_line.request(frame, ANGLES)
    for bit in range(8 * len(right)):
        damaged = bytearray(right)
        damaged[bit // 8] ^= 1 << bit % 8
        master, _ = asked(frame)
        assert master.feed(bytes(damaged), 0.01) == []
        assert given_up(master)
    for bit in range(8 * len(whole)):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        assert not isinstance(PolledLineUnit(frame).feed(bytes(damaged)), Poll)


@given(st.lists(st.integers(0, 40), max_size=6), st.booleans())
def test_a_reply_is_read_however_it_is_cut_and_with_or_without_an_echo(cuts, echo):
    master, right = asked()
    data = (polled_line.request(FRAME, ANGLES) if echo else b"") + right
    at = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    got = [one for a, b in itertools.pairwise(at) for one in master.feed(data[a:b], 0.01)]
    assert len(got) == 1
    assert master.trouble == {}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda _: b"", "no reply: check power"),
        (lambda right: right[:5], "part of a reply"),
        (lambda right: right[:-1] + bytes([right[-1] ^ 1]), "wrong check"),
        (lambda _: b"\x55\xaa" * 9, "noise, wrong baud, or a frame"),
        (
            lambda _: polled_line.reply(dataclasses.replace(FRAME, address=5), ANGLES, VALUES),
            "a reply of unit 5 in place of unit 1",
        ),
    ],
)
def test_each_fault_of_a_reply_is_named_and_the_request_repeated_once_the_line_is_quiet(change, words):
    master, right = asked()
    assert master.feed(change(right), 0.01) == []
    assert master.due(0.05) == b""
    assert master.due(0.11) == b""
    assert words in next(iter(master.trouble))
    # Quiet for as long as the timeout, then the same request again; a right reply to it is taken.
    assert master.due(0.2) == b""
    assert master.due(0.22) == polled_line.request(FRAME, ANGLES)
    assert len(master.feed(right, 0.23)) == 1


def test_a_request_that_is_never_answered_is_given_up_and_the_next_round_comes():
    master, _ = asked()
    times = [k * 0.01 for k in range(1, 200)]
    sent = [now for now in times if master.due(now)]
    assert master.counters.lost >= 1
    assert all(later - earlier > 0.19 for earlier, later in itertools.pairwise(sent))


def test_a_late_reply_is_dropped_and_said_and_does_not_count_for_the_next_request():
    master, right = asked()
    master.due(0.11)
    assert master.feed(right, 0.15) == []
    assert any("later than timeout_s" in words for words in master.trouble)
    # The line must be quiet again from then on.
    assert master.due(0.22) == b""
    assert master.due(0.26) == polled_line.request(FRAME, ANGLES)


def test_noise_before_a_reply_is_said_and_the_reply_is_read():
    master, right = asked()
    assert len(master.feed(b"\x00\xff\x01\x03" + right, 0.01)) == 1
    assert "noise, or another unit" in next(iter(master.trouble))


def test_a_refusal_is_said_with_its_reason():
    frame = dataclasses.replace(FRAME, polls=(dataclasses.replace(ANGLES, request="0100 0003"),))
    master = Master(frame)
    refused = PolledLineUnit(FRAME).feed(master.due(0.0))
    assert master.feed(refused, 0.01) == []
    assert list(master.trouble) == ["the unit refuses command 3: unknown data"]
    other = dataclasses.replace(FRAME, polls=(dataclasses.replace(ANGLES, command=6),))
    master = Master(other)
    master.feed(PolledLineUnit(FRAME).feed(master.due(0.0)), 0.01)
    assert list(master.trouble) == ["the unit refuses command 6: unknown command"]


def test_a_host_that_is_slower_than_the_unit_gets_one_answer_to_requests_that_piled_up():
    unit, whole = PolledLineUnit(FRAME), polled_line.request(FRAME, ANGLES)
    assert unit.feed(3 * whole) == ANGLES
    assert unit.answered == 1
    assert unit.feed(b"") is None


def test_a_unit_is_silent_for_requests_to_others_and_for_damaged_ones():
    unit = PolledLineUnit(FRAME)
    other = dataclasses.replace(FRAME, address=2)
    talk = polled_line.request(other, ANGLES) + polled_line.reply(other, ANGLES, VALUES)
    assert unit.feed(talk) is None
    assert unit.trouble == {}
    whole = polled_line.request(FRAME, ANGLES)
    assert unit.feed(whole[:-1] + bytes([whole[-1] ^ 0x10])) is None
    assert "wrong check" in next(iter(unit.trouble))
    assert unit.feed(talk + whole) == ANGLES


@given(st.binary(max_size=600), st.integers(1, 50))
def test_any_bytes_are_survived_by_both_ends(data, step):
    unit, (master, right) = PolledLineUnit(FRAME), asked()
    for at in range(0, len(data), step):
        unit.feed(data[at : at + step])
        master.feed(data[at : at + step], 0.01)
    unit.feed(bytes(600))
    assert unit.feed(polled_line.request(FRAME, ANGLES)) == ANGLES
    given_up(master)
    assert master.due(20.0)
    assert len(master.feed(right, 20.01)) == 1


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("addres: 1", "address"),
        ("polls: []", "at least one"),
        ("polls: [{command: 4, items: []}]", "at least one number"),
        ("polls: [{request: xyz, items: [{quantity: time}]}]", "in hex"),
        ("polls: [{items: [{quantity: rate_x, step: 0.0}]}]", "must not be 0"),
        ("polls: [{items: [{quantity: rate_x, step: 5.0e-324, unit: deg}]}]", "must not be 0"),
        ("polls: [{items: [{quantity: rate_x, step: .inf}]}]", "finite"),
        ("polls: [{items: [{quantity: rate_x, unit: degrees}]}]", "'degrees' is not one of rad, deg"),
        ("polls: [{items: [{quantity: rate_q}]}]", "rate_"),
        ("polls: [{items: [{quantity: time}]}, {items: [{quantity: rate_x}]}]", "the same"),
    ],
)
def test_a_frame_file_that_cannot_be_is_refused_with_its_name(tmp_path, text, complaint):
    (tmp_path / "frame.yaml").write_text(text)
    with pytest.raises(ValueError, match=complaint) as caught:
        polled_line.read(tmp_path / "frame.yaml", polled_line.PROBE_QUANTITIES)
    assert "frame.yaml" in str(caught.value)


@pytest.mark.parametrize("form", polled_line.FORMS)
@pytest.mark.parametrize("value", [math.inf, -math.inf, 1e308, -1e308])
def test_a_value_beyond_every_form_is_sent_and_never_stops_the_line(form, value):
    poll = Poll(4, "", (ReplyItem("inclination", form, 1e-15, unit="nT"),))
    frame = dataclasses.replace(FRAME, polls=(poll,))
    master = Master(frame)
    master.due(0.0)
    ((values, _),) = master.feed(polled_line.reply(frame, poll, {"inclination": value}), 0.01)
    assert math.isnan(values["inclination"])


@pytest.mark.parametrize(("unit", "one"), [("deg/s", math.pi / 180.0), ("deg", math.pi / 180.0), ("ft", 0.3048)])
def test_a_unit_is_converted_to_si(unit, one):
    assert ReplyItem("rate_x", unit=unit).line == (0.0, pytest.approx(one))


@pytest.mark.parametrize("text", ["s3cret-token", "- s3cret", "a: 1\ns3cret: [", "-----BEGIN KEY-----\ns3cret"])
def test_a_file_that_is_no_frame_is_not_quoted(tmp_path, text):
    (tmp_path / "token").write_text(text)
    with pytest.raises(ValueError, match=r"token.*does not have the expected content") as caught:
        polled_line.read(tmp_path / "token", polled_line.PROBE_QUANTITIES)
    assert "s3cret" not in str(caught.value)
