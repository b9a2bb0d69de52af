# SPDX-License-Identifier: Apache-2.0
"""What `mwd run` waits for while its nodes start."""

import pytest

from mwd_surface.commands.run_graph import StartError, waits_for

READY = {"estimator": "preparing the filters\nthe filters are ready\n", "surface": ""}


def page(message):
    return {"diagnostics": {"rows": [{"name": "well_1/estimator: lifecycle", "message": message}]}}


def test_nothing_is_missing_once_the_estimator_is_active():
    assert waits_for(page("active"), READY) == ""


@pytest.mark.parametrize(
    ("state", "logs", "word"),
    [
        ({}, {}, "its page does not answer"),
        ({}, {"estimator": "preparing the filters; the first time ..."}, "is compiling its filters"),
        ({"diagnostics": {"rows": []}}, READY, "receives nothing from the estimator"),
        (page("inactive"), READY, "the estimator is inactive"),
    ],
)
def test_what_is_missing_is_named(state, logs, word):
    assert word in waits_for(state, logs)


def test_a_node_that_cannot_be_configured_ends_the_wait():
    logs = READY | {"surface": "[ERROR] cannot configure: port 8080 is taken\nTraceback"}
    with pytest.raises(StartError, match="surface cannot start: port 8080 is taken"):
        waits_for({}, logs)
