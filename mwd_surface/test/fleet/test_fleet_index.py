# SPDX-License-Identifier: Apache-2.0
"""The page of a fleet: failures first with their reasons, sums of what was worked out, nothing that runs or fetches."""

import pytest

from mwd_surface.fleet import fleet_run
from mwd_surface.fleet.fleet_dataset import DONE, FAILED
from mwd_surface.fleet.fleet_task import Outcome

ROW = {
    "outcome": DONE,
    "bytes": 1000,
    "seconds": 5400.0,
    "samples": 540_000,
    "samples_rejected": 12,
    "gaps": 3,
    "surveys": 4,
    "surveys_accepted": 2,
    "surveys_doubtful": 1,
    "surveys_rejected": 1,
    "warnings": ["no magnetometer", "two clocks"],
}


def done(bag, **changes):
    return Outcome(bag, "k", {**ROW, **changes})


def failed(bag, reason):
    return Outcome(bag, "", {**dict.fromkeys(ROW), "outcome": FAILED, "bytes": 10, "reason": reason, "warnings": []})


def test_failures_stand_first_and_each_kind_in_order_of_name():
    page = fleet_run.index_html([done("/b"), failed("/z", "cut off"), done("/a"), failed("/y", "empty")])
    places = [page.index(f">{bag}<") for bag in ("/y", "/z", "/a", "/b")]
    assert places == sorted(places)
    assert page.index("cut off") < page.index(">/a<")


def test_the_head_sums_what_was_worked_out_and_counts_what_failed():
    page = fleet_run.index_html([done("/a"), done("/b", seconds=1800.0, surveys=1), failed("/c", "empty")])
    text = " ".join(page.split())
    for name, value in (
        ("processed", "2 of 3"),
        ("failed", "1"),
        ("hours", "2.00"),
        ("IMU samples", "1080000"),
        ("bytes", "2010"),
        ("surveys", "5"),
        ("accepted", "4"),
    ):
        assert f"<dt>{name}</dt><dd>{value}</dd>" in text
    assert "no magnetometer; two clocks" in text


def test_a_fleet_of_failures_and_one_of_nothing_have_a_page_too():
    assert "<dd>0 of 1</dd>" in fleet_run.index_html([failed("/a", "empty")])
    assert "Fleet of 0 recordings" in fleet_run.index_html([])


def test_texts_of_recordings_cannot_become_part_of_the_page():
    page = fleet_run.index_html(
        [failed("/<script>alert(1)</script>", "<img src=x>"), done("/a", warnings=["<b>bold</b>"])]
    )
    assert "<script" not in page
    assert "<img" not in page
    assert "<b>" not in page
    assert "default-src 'none'" in page


def test_the_page_is_written_whole_over_an_earlier_one(tmp_path):
    for outcomes in ([done("/a")], [done("/é")]):
        assert fleet_run.write_index(tmp_path, outcomes) == tmp_path / "index.html"
    assert (tmp_path / "index.html").read_text(encoding="utf-8") == fleet_run.index_html([done("/é")])
    assert [file.name for file in tmp_path.iterdir()] == ["index.html"]
    with pytest.raises(FileNotFoundError):
        fleet_run.write_index(tmp_path / "nowhere", [])
