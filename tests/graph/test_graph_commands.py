# SPDX-License-Identifier: Apache-2.0
"""What `mwd call`, `mwd param` and `mwd topic` do in a running graph."""

import subprocess
import sys

import pytest

import running_graph
from running_graph import PLACE, until

pytestmark = [pytest.mark.ros, pytest.mark.slow(15)]


def mwd(graph, *words):
    """Output and status of a command of `mwd` in the domain of the graph."""
    command = [sys.executable, "-P", "-m", "mwd_surface.cli", *words]
    done = subprocess.run(command, env=graph.environment, capture_output=True, text=True, timeout=480, check=False)
    return done.stdout + done.stderr, done.returncode


def test_services_parameters_and_topics_are_reached_by_the_end_of_their_names(tmp_path):
    with running_graph.graph(tmp_path) as graph:
        estimator = graph.start("estimator", "w1", **{k.replace(".", "__"): v for k, v in PLACE.items()})
        until(lambda: ": active" in graph.log(estimator), 90, "the estimator is active")
        assert "/w1/take_survey" in mwd(graph, "call")[0]
        text, status = mwd(graph, "call", "reset_estimator")
        assert "success: true" in text
        assert status == 0
        text, status = mwd(graph, "call", "/w1/take_survey", "duration=4")
        assert "no samples arrive from the sonde" in text
        assert status == 1
        text, status = mwd(graph, "call", "take_survey", "duratoin=4")
        assert "the fields are duration" in text
        assert status == 2
        assert "did you mean /w1/take_survey" in mwd(graph, "call", "take_survy")[0]
        assert (
            mwd(graph, "param", "set", "estimator", "survey.duration_s", "12")[0].strip() == "survey.duration_s is set"
        )
        assert "survey.duration_s: 12.0" in mwd(graph, "param", "get", "estimator", "survey.duration_s")[0]
        text, status = mwd(graph, "param", "set", "estimator", "survey.duration_s", "0.1")
        assert "survey.duration_s was not set" in text
        assert status == 2
        assert "/w1/attitude" in mwd(graph, "topic", "list")[0]
        assert "estimator: lifecycle" in mwd(graph, "topic", "echo", "/diagnostics", "-n", "1", "--seconds", "30")[0]
        assert graph.end(estimator)[0] == 0
