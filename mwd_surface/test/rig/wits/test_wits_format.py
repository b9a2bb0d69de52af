# SPDX-License-Identifier: Apache-2.0
"""WITS level 0 framing: strict out, tolerant in, bounded whatever comes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.rig.wits.format import KEEP_ALIVE, Decoder, checked_text, encode, plain_text

pytestmark = pytest.mark.slow(0.1)


def numbers(frame):
    return {item.code: item.number for item in frame.items}


def test_a_packet_is_marks_and_lines_with_crlf():
    assert encode([(713, "45.12"), (715, "121.30")]) == b"&&\r\n071345.12\r\n0715121.30\r\n!!\r\n"
    assert encode([(111, "-9999")]) == KEEP_ALIVE
    assert encode([(713, "1.00")], source="MWD-ROS2").startswith(b"&&\r\n1984MWD-ROS2\r\n0713")


@pytest.mark.parametrize("text", ["a\r\nb", "a!!", "&&", "Å", "tab\t", "\0"])
def test_a_text_that_would_break_the_frame_is_refused(text):
    with pytest.raises(ValueError, match="text"):
        checked_text(text)
    assert checked_text(plain_text(text)) == plain_text(text)


@pytest.mark.parametrize("code", [0, 99, 100, 700, 10000])
def test_a_code_that_is_no_item_is_refused(code):
    with pytest.raises(ValueError, match="code"):
        encode([(code, "1")])


@pytest.mark.parametrize(
    "data",
    [
        b"&&\r\n01082214.3\r\n01102215\r\n!!\r\n",
        b"&&\n01082214.3\n01102215\n!!\n",
        b"&&\r01082214.3\r01102215\r!!\r",
        b"&&\r\n0108 2214.3\r\n0110\t+2.215E3\r\n!!",
        b"\xff\x00junk&&\r\n01082214.3\r\n0110002215\r\n!!",
    ],
)
def test_every_usual_form_of_a_frame_is_read(data):
    for step in (1, 2, 3, 7, len(data)):
        decoder = Decoder()
        frames = [f for at in range(0, len(data), step) for f in decoder.feed(data[at : at + step])]
        assert [numbers(f) for f in frames] == [{108: 2214.3, 110: 2215.0}]


def test_a_frame_without_line_ends_is_read():
    (frame,) = Decoder().feed(b"&&0208100!!")
    assert numbers(frame) == {208: 100.0}


def test_several_frames_in_one_read_come_in_order_and_junk_between_them_is_counted():
    decoder = Decoder()
    frames = decoder.feed(b"&&\r\n01081\r\n!!\r\nxyz\r\n&&\r\n01082\r\n!!\r\n")
    assert [f.number(108) for f in frames] == [1.0, 2.0]
    assert (decoder.counts.junk_bytes, decoder.counts.frames) == (3, 2)


@pytest.mark.fault_case(74)
@pytest.mark.parametrize("text", ["-9999", "-9999.00", "-8888", "-999.25", ""])
def test_a_null_is_no_number(text):
    decoder = Decoder()
    (frame,) = decoder.feed(b"&&\r\n0108" + text.encode() + b"\r\n!!\r\n")
    assert frame.number(108) is None
    assert frame.items[0].null
    assert decoder.counts.nulls == 1


@pytest.mark.parametrize("text", ["NaN", "nan", "-inf", "Infinity", "1e999"])
def test_what_is_not_finite_is_thrown_away_and_the_frame_kept(text):
    decoder = Decoder()
    (frame,) = decoder.feed(f"&&\r\n0108{text}\r\n01105\r\n!!\r\n".encode())
    assert numbers(frame) == {110: 5.0}
    assert decoder.counts.bad_items == 1


def test_lines_that_are_no_items_are_counted():
    decoder = Decoder()
    (frame,) = decoder.feed(b"&&\r\nhello\r\n0000 1\r\n07001\r\n01\r\n0108\x01\x02\r\n01085\r\n!!\r\n")
    assert numbers(frame) == {108: 5.0}
    assert decoder.counts.bad_items == 5


def test_an_unterminated_frame_is_dropped_at_the_next_beginning():
    decoder = Decoder()
    frames = decoder.feed(b"&&\r\n01081\r\n&&\r\n01082\r\n!!\r\n")
    assert [f.number(108) for f in frames] == [2.0]
    assert decoder.counts.broken_frames == 1


@pytest.mark.fault_case(72)
@pytest.mark.parametrize("piece", [b"x" * 4096, b"\0" * 4096, b"0108123\r\n" * 400, b"&" + b"y" * 4095, b"&" * 4096])
def test_a_megabyte_without_an_end_stays_bounded_and_reading_goes_on(piece):
    decoder = Decoder()
    decoder.feed(b"&&\r\n")
    most = 0
    for _ in range(1_000_000 // 4096):
        decoder.feed(piece)
        most = max(most, decoder.waiting)
    assert most <= 65536 + 16384
    assert [f.number(108) for f in decoder.feed(b"\r\n&&\r\n01087\r\n!!\r\n")] == [7.0]


@pytest.mark.fault_case(72)
@given(data=st.binary(max_size=400), cut=st.integers(1, 50))
def test_any_bytes_are_survived_and_a_good_frame_after_them_is_read(data, cut):
    decoder = Decoder()
    for at in range(0, len(data), cut):
        decoder.feed(data[at : at + cut])
    frames = decoder.feed(b"\n&&\r\n01087\r\n!!\r\n")
    assert frames
    assert frames[-1].number(108) == 7.0


@given(
    values=st.lists(
        st.tuples(st.integers(1, 99), st.integers(1, 99), st.floats(-1e6, 1e6).filter(lambda v: v > -900)), max_size=30
    ),
    cut=st.integers(1, 20),
)
def test_what_is_written_is_read_back(values, cut):
    items = [(r * 100 + i, f"{v:.3f}") for r, i, v in values]
    data = encode(items)
    decoder = Decoder()
    (frame,) = [f for at in range(0, len(data), cut) for f in decoder.feed(data[at : at + cut])]
    assert [(i.code, i.number) for i in frame.items] == [(c, float(t)) for c, t in items]
