# SPDX-License-Identifier: Apache-2.0
"""The slide sheet on disk: what was put there comes back, whatever happened to the supply in between."""

import os

import pytest

from mwd_surface.trajectory.slide_sheet import ROTATE, SLIDE, DrilledStretch, append_stretch, read_stretches

ONE = DrilledStretch(
    SLIDE, 1.0, 2.0, 1_700_000_000_000_000_003, 1_700_000_000_000_000_004, 0.1 + 0.2, 0.9, magnetic=True
)
TWO = DrilledStretch(ROTATE, 2.0, 9.0, 4, 5, rotary_speed=12.0)


def test_no_file_is_an_empty_sheet(tmp_path):
    assert read_stretches(tmp_path / "slides.jsonl") == ((), 0)


def test_stretches_come_back_in_order_and_to_the_last_digit(tmp_path):
    path = tmp_path / "surveys" / "slides.jsonl"
    append_stretch(path, ONE)
    append_stretch(path, TWO)
    assert read_stretches(path) == ((ONE, TWO), 0)
    assert len(path.read_text().splitlines()) == 2


@pytest.mark.parametrize("cut", range(1, 60, 7))
def test_a_line_cut_off_by_a_lost_supply_takes_no_other_with_it(tmp_path, cut):
    path = tmp_path / "slides.jsonl"
    append_stretch(path, ONE)
    whole = path.read_bytes()
    path.write_bytes(whole + whole[:cut])
    append_stretch(path, TWO)
    assert read_stretches(path) == ((ONE, TWO), 1)


@pytest.mark.parametrize(
    "line",
    [
        b"\x00\x00\x00\x00",
        b"\xff\xfe rubbish",
        b"[1, 2]",
        b"null",
        b"[" * 200_000,
        b'{"mode": "slide"}',
        b'{"mode": "glide", "from_depth": 1.0, "to_depth": 2.0, "begin_ns": 1, "end_ns": 2}',
        b'{"mode": "slide", "from_depth": NaN, "to_depth": 2.0, "begin_ns": 1, "end_ns": 2}',
        b'{"mode": "slide", "from_depth": 1.0, "to_depth": 2.0, "begin_ns": 1, "end_ns": 2, "feet": 3}',
    ],
)
def test_a_line_that_is_no_stretch_is_counted_and_left_out(tmp_path, line):
    path = tmp_path / "slides.jsonl"
    append_stretch(path, ONE)
    with path.open("ab") as file:
        file.write(line + b"\n")
    append_stretch(path, TWO)
    assert read_stretches(path) == ((ONE, TWO), 1)


def test_a_stretch_is_on_the_disk_when_the_call_returns(tmp_path, monkeypatch):
    path, forced = tmp_path / "slides.jsonl", []
    monkeypatch.setattr(os, "fsync", lambda _file: forced.append(path.read_bytes()))
    append_stretch(path, ONE)
    assert forced == [path.read_bytes()]


def test_what_the_disk_refuses_is_reported(tmp_path):
    (tmp_path / "surveys").write_text("a file where the folder should be")
    with pytest.raises(OSError, match="surveys"):
        append_stretch(tmp_path / "surveys" / "slides.jsonl", ONE)
