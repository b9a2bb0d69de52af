# SPDX-License-Identifier: Apache-2.0
"""Picture of two runs: what is drawn, and that long runs are thinned."""

import numpy as np
import pytest

from mwd_surface.plots import run_comparison


def run(name, count=400, azimuth=359.0, step_ns=10_000_000):
    stamps = np.arange(count) * step_ns
    angles = {"inclination_deg": np.full(count, 30.0), "azimuth_deg": np.full(count, azimuth % 360.0)}
    rows = {"stamp_ns": stamps, **angles}
    blocks = [{key: part[k : k + 1000] for key, part in rows.items()} for k in range(0, count, 1000)]
    survey = {"stamp_ns": "2000000000", "inclination_deg": "30.1", "azimuth_deg": str(azimuth % 360.0)}
    return run_comparison.ComparedRun(name, blocks, [survey])


@pytest.mark.slow
def test_two_runs_are_drawn():
    *angles, apart = run_comparison.picture(run("a"), run("b", azimuth=1.0, count=300)).axes
    assert [ax.get_legend_handles_labels()[1] for ax in angles] == [["a", "b"]] * 2
    assert apart.lines[1].get_ydata() == pytest.approx(np.full(400, -2.0))


def test_the_difference_of_azimuths_goes_the_short_way_round():
    ours, expected = (run_comparison.thinned(run(name, azimuth=a).attitude) for name, a in (("a", 359.0), ("b", 361.0)))
    found = run_comparison.differences(ours, expected)
    assert found["azimuth_deg"] == pytest.approx(np.full(400, -2.0), abs=1e-9)
    assert found["inclination_deg"] == pytest.approx(np.zeros(400), abs=1e-9)


def test_a_long_run_is_thinned_evenly():
    rows = run_comparison.thinned(run("a", count=60_000).attitude)
    assert 3000 < len(rows["stamp_ns"]) <= 12_000
    assert len(set(np.diff(rows["stamp_ns"]).tolist())) == 1
