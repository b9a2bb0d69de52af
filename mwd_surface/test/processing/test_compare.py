# SPDX-License-Identifier: Apache-2.0
"""Two runs beside each other: what is the same, what is not, and what the limits allow."""

import csv
import io
import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.commands.compare import _show
from mwd_surface.processing import attitude_csv, compare, run_folder
from mwd_surface.surveys import survey_csv

STATION = {
    "sequence": "1",
    "stamp_ns": "10000000000",
    "md_m": "490.000",
    "inclination_deg": "40.0000",
    "azimuth_deg": "359.9999",
    "toolface_deg": "120.0000",
    "sigma_inclination_deg": "0.0500",
    "sigma_azimuth_deg": "0.5000",
    "sigma_toolface_deg": "0.1000",
    "azimuth_reference": "true",
    "azimuth_method": "corrected",
    "verdict": "accept",
}


def write_run(folder, stations=(STATION,), rows=50, step_ns=10**8, azimuth=0.5, skip=(), status="still"):
    """A run of a tool that keeps still; `skip`: rows that are not there."""
    folder.mkdir()
    out = io.StringIO()
    writer = csv.DictWriter(out, survey_csv.COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(stations)
    (folder / "surveys.csv").write_text(out.getvalue())
    lines = (
        f"{k * step_ns},40.0000,{azimuth:.4f},120.0000,0.0500,0.5000,0.1000,0.6,0.0,0.8,{status}"
        for k in range(rows)
        if k not in skip
    )
    (folder / "attitude.csv").write_text("\n".join((attitude_csv.HEADER, *lines)) + "\n")
    return folder


def test_a_run_agrees_with_itself_to_every_digit(tmp_path):
    run = write_run(tmp_path / "a")
    found = compare.compare(run, run)
    assert found.agree
    assert (found.rows, found.rows_missing, found.rows_extra) == (50, 0, 0)
    assert {one.name: one.largest for one in found.statistics} == dict.fromkeys(
        ("inclination", "azimuth", "toolface", "gravity"), 0.0
    )


def test_a_difference_across_north_is_the_short_way_round(tmp_path):
    ours = write_run(tmp_path / "a", [{**STATION, "azimuth_deg": "0.0001"}], azimuth=359.9)
    expected = write_run(tmp_path / "b", azimuth=0.1)
    found = compare.compare(ours, expected)
    assert found.stations[0].differences["azimuth_deg"] == pytest.approx(0.0002)
    (azimuth,) = [one for one in found.statistics if one.name == "azimuth"]
    assert (azimuth.mean, azimuth.largest) == (pytest.approx(-0.2), pytest.approx(0.2))
    assert not found.agree
    assert compare.compare(ours, expected, {"survey_azimuth_deg": 0.001, "attitude_azimuth_deg": 0.3}).agree


def test_an_azimuth_that_neither_run_has_is_no_difference_and_no_agreement(tmp_path, capsys):
    """It was printed as a difference of +0.0000 deg."""
    bare = {**STATION, "azimuth_deg": "", "sigma_azimuth_deg": "", "azimuth_method": ""}
    run = write_run(tmp_path / "a", [bare])
    found = compare.compare(run, run)
    assert found.agree
    assert found.stations[0].unknown == {"azimuth_deg", "sigma_azimuth_deg"}
    _show(found, ("a", "b"), limited=False)
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "490.000" in line]
    assert line.split() == ["1", "490.000", "+0.000", "+0.0000", "-", "+0.0000"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"verdict": "reject"}, "verdict: reject, expected accept"),
        ({"azimuth_method": "raw"}, "azimuth method: raw, expected corrected"),
        ({"inclination_deg": "40.1000"}, "inclination_deg differs by +0.1"),
        ({"azimuth_deg": ""}, "azimuth_deg differs by +nan"),
        ({"sigma_azimuth_deg": "1.0000"}, "sigma_azimuth_deg differs by +1"),
        ({"stamp_ns": "10500000000"}, "taken +0.500 s"),
    ],
)
def test_what_differs_at_a_station_is_reported(tmp_path, changes, words):
    ours = write_run(tmp_path / "a", [{**STATION, **changes}])
    found = compare.compare(ours, write_run(tmp_path / "b"))
    assert any(words in failure for failure in found.failures), found.failures


def test_stations_are_paired_by_time_and_the_lonely_ones_named(tmp_path):
    later = {**STATION, "sequence": "2", "stamp_ns": "90000000000", "md_m": ""}
    found = compare.compare(write_run(tmp_path / "a", [later]), write_run(tmp_path / "b"))
    assert found.missing == ("1 at 490.000 m",)
    assert found.extra == ("2 at unknown depth",)
    assert not found.stations


def test_an_expected_run_may_keep_fewer_samples_but_ours_may_not(tmp_path):
    whole = write_run(tmp_path / "a")
    sampled = write_run(tmp_path / "b", skip=set(range(50)) - {0, 10, 49})
    assert compare.compare(whole, sampled).agree
    found = compare.compare(sampled, whole)
    assert found.rows_missing == 47
    assert any("47 samples" in failure for failure in found.failures)


def test_other_status_words_count_by_their_share(tmp_path):
    ours, expected = write_run(tmp_path / "a", status="still|gap"), write_run(tmp_path / "b")
    assert compare.compare(ours, expected).failures == ("status differs at 50 of 50 samples",)
    assert compare.compare(ours, expected, {"attitude_status_share": 1.0}).agree


def test_runs_without_a_sample_in_common_do_not_agree(tmp_path):
    found = compare.compare(write_run(tmp_path / "a", rows=0), write_run(tmp_path / "b", rows=0))
    assert found.failures == ("the attitudes have no sample in common",)


def test_a_limit_needs_a_known_name_a_number_and_in_a_file_its_reason(tmp_path):
    with pytest.raises(ValueError, match="limit azimuth: unknown"):
        compare.checked_limits({"azimuth": 1.0})
    with pytest.raises(ValueError, match="0 or more"):
        compare.checked_limits({"survey_azimuth_deg": math.nan})
    file = tmp_path / "limits.yaml"
    file.write_text("survey_azimuth_deg: {limit: 0.1, reason: the noise of one station}\n")
    assert compare.read_limits(file) == {"survey_azimuth_deg": 0.1}
    file.write_text("survey_azimuth_deg: {limit: 0.1, reason: ''}\n")
    with pytest.raises(ValueError, match="`limit` and `reason`"):
        compare.read_limits(file)


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    run = write_run(tmp_path / "a")
    (run / "attitude.csv").write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="is not what `mwd process` writes"):
        compare.compare(run, run)
    (run / "attitude.csv").unlink()
    assert not run_folder.is_run(run)
    with pytest.raises(FileNotFoundError):
        compare.compare(run, run)


@given(
    st.lists(st.integers(0, 40), max_size=50).map(sorted),
    st.lists(st.integers(0, 40), max_size=50).map(sorted),
    st.integers(1, 7),
    st.integers(1, 7),
)
def test_the_samples_in_common_do_not_depend_on_how_the_files_are_cut(ours, expected, cut_a, cut_b):
    def blocks(stamps, size):
        # A coarse clock gives several samples one stamp: they are known by their place.
        rows = [100 * stamp + stamps[:k].count(stamp) for k, stamp in enumerate(stamps)]
        for start in range(0, len(stamps), size):
            part = slice(start, start + size)
            yield {"stamp_ns": np.array(stamps[part]), "row": np.array(rows[part])}

    walk = compare._Walk()
    common = []
    for a, b in compare._side_by_side(blocks(ours, cut_a), blocks(expected, cut_b), walk):
        assert a["row"].tolist() == b["row"].tolist()
        common += a["stamp_ns"].tolist()
    ours, expected = Counter(ours), Counter(expected)
    assert common == sorted((ours & expected).elements())
    assert walk.rows_extra == (ours - expected).total()
    assert walk.rows_missing == (expected - ours).total()
