# SPDX-License-Identifier: Apache-2.0
"""What `mwd call`, `mwd param` and `mwd topic` do in a running graph."""

import pytest

import running_graph
from running_graph import PLACE

pytestmark = [pytest.mark.ros, pytest.mark.slow(17)]

# Words of each command, what it prints and its status.
COMMANDS = (
    ("call", "/w1/take_survey", 0),
    ("call reset_estimator", "success: true", 0),
    ("call /w1/take_survey duration=4", "no samples arrive from the sonde", 1),
    ("call take_survey duratoin=4", "the fields are duration", 2),
    ("call take_survy", "did you mean /w1/take_survey", 2),
    ("param set estimator survey.duration_s 12", "survey.duration_s is set", 0),
    ("param get estimator survey.duration_s", "survey.duration_s: 12.0", 0),
    ("param set estimator survey.duration_s 0.1", "survey.duration_s was not set", 2),
    ("topic list", "/w1/attitude", 0),
    ("topic echo /diagnostics -n 1 --seconds 30", "estimator: lifecycle", 0),
)


def test_services_parameters_and_topics_are_reached_by_the_end_of_their_names(tmp_path):
    with running_graph.graph(tmp_path) as graph:
        estimator = graph.start("estimator", "w1", **PLACE)
        graph.active(estimator)
        said = graph.commands(*(command for command, _, _ in COMMANDS))
        assert graph.end(estimator)[0] == 0
    for (command, words, status), (ended, printed) in zip(COMMANDS, said, strict=True):
        assert words in printed, command
        assert ended == status, (command, printed)
