# SPDX-License-Identifier: Apache-2.0
"""Picture of two runs: what is drawn, and that long runs are thinned."""

import numpy as np
import pytest

from mwd_surface.plots import run_comparison

HEADER = "stamp_ns,inclination_deg,azimuth_deg,toolface_deg,gravity_x,gravity_y,gravity_z,status"


def run(folder, count=400, azimuth=359.0, step_ns=10_000_000):
    folder.mkdir()
    lines = [f"{k * step_ns},30.0,{azimuth % 360.0},0.0,0.0,0.0,1.0," for k in range(count)]
    (folder / "attitude.csv").write_text("\n".join([HEADER, *lines]) + "\n")
    (folder / "surveys.csv").write_text(f"stamp_ns,inclination_deg,azimuth_deg\n2000000000,30.1,{azimuth % 360.0}\n")
    return folder


def test_two_runs_are_drawn(tmp_path):
    picture = run_comparison.picture(run(tmp_path / "a"), run(tmp_path / "b", azimuth=1.0, count=300))
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 10_000


def test_the_difference_of_azimuths_goes_the_short_way_round(tmp_path):
    ours, expected = (
        run_comparison.thinned(run(tmp_path / name, azimuth=a)) for name, a in (("a", 359.0), ("b", 361.0))
    )
    found = run_comparison.differences(ours, expected)
    assert found["azimuth_deg"] == pytest.approx(np.full(400, -2.0), abs=1e-9)
    assert found["inclination_deg"] == pytest.approx(np.zeros(400), abs=1e-9)


def test_a_long_run_is_thinned_evenly(tmp_path):
    rows = run_comparison.thinned(run(tmp_path / "a", count=60_000))
    assert 3000 < len(rows["stamp_ns"]) <= 12_000
    assert len(set(np.diff(rows["stamp_ns"]).tolist())) == 1


def test_a_folder_without_an_attitude_is_refused(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(FileNotFoundError, match="no attitude"):
        run_comparison.picture(tmp_path / "a", tmp_path / "a")
