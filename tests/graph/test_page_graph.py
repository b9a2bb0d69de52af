# SPDX-License-Identifier: Apache-2.0
"""The page's buttons among real nodes: what a person asked for and did not get is said on the page."""

import contextlib
import json
import urllib.error
import urllib.request

import pytest

import running_graph
from running_graph import PLACE, until

pytestmark = [pytest.mark.ros, pytest.mark.slow]
TOKEN = "a-long-secret"  # noqa: S105


def opened(address, body=None):
    """JSON answer of the page."""
    headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"}
    asked = urllib.request.Request(address, data=body, headers=headers)  # noqa: S310
    with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(asked, timeout=10.0) as answer:
        return json.load(answer)


def test_a_survey_that_is_not_granted_says_why_under_survey(tmp_path):
    with running_graph.graph(tmp_path) as graph:
        graph.environment["MWD_PAGE_TOKEN"] = TOKEN
        surface = graph.start("surface", "w1", folder=tmp_path / "data", page__port=0)
        estimator = graph.start("estimator", "w1", **{k.replace(".", "__"): v for k, v in PLACE.items()})
        for name in (surface, estimator):
            until(lambda name=name: ": active" in graph.log(name), 90, f"{name} is active")
        address = until(lambda: graph.log(surface).partition("page: ")[2].split()[:1], 20, "the address")[0]

        def shown(section):
            # Before the first state there are no sections.
            return opened(f"{address}state.json")["sections"].get(section, {})

        def answered():
            with contextlib.suppress(urllib.error.HTTPError):
                return opened(f"{address}command/take_survey", b"{}")["ok"]
            return False

        until(answered, 30, "the estimator's service is there")

        def result():
            return shown("survey_progress").get("result")

        assert until(result, 20, "a result") == "no survey taken: no samples arrive from the sonde"
        # The threshold between the toolfaces is the estimator's.
        until(lambda: shown("toolface").get("threshold"), 20, "the threshold")
