# SPDX-License-Identifier: Apache-2.0
"""The notebooks run as they are printed, and what their text says of the figures is so."""

import json
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "docs" / "examples"

pytestmark = pytest.mark.slow(7)


def played(name):
    """Names that a notebook has made once all its cells have run."""
    mpl.use("Agg")
    names = {}
    for cell in json.loads((EXAMPLES / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), name, "exec"), names)  # noqa: S102  (our own notebook)
    sys.modules["matplotlib.pyplot"].close("all")
    return names


def test_the_drilling_interval_shows_an_accelerometer_off_by_tens_of_degrees_and_an_estimator_that_is_not():
    names = played("drilling_interval")
    assert np.nanmax(np.abs(names["raw_error"])) > 20.0
    assert np.sqrt(np.mean(names["error"] ** 2)) < 0.2
    assert names["within"] > 0.8


def test_the_survey_run_lists_stations_whose_truth_lies_within_their_sigma():
    surveys = played("survey_run")["surveys"]
    known = np.isfinite(surveys["azimuth_deg"])
    assert known.sum() > 2
    off = np.abs(surveys["azimuth_deg"][known] - 90.0) / surveys["sigma_azimuth_deg"][known]
    assert off.max() < 3.5
