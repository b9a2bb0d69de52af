# SPDX-License-Identifier: Apache-2.0
"""The recording that the pictures are drawn of, made once."""

import plotted_bag
import pytest


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    """The recording of a run with everything that is drawn, and its sonde."""
    path = tmp_path_factory.mktemp("plotted") / "run"
    return path, plotted_bag.record(path)
