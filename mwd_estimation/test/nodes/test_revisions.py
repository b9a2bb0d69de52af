# SPDX-License-Identifier: Apache-2.0
"""Surveys judged again beside the samples: each change is published once, counted from the first value on."""

import dataclasses
import time
from types import SimpleNamespace

import numpy as np
import pytest

from mwd_estimation.core.time_bins import Average
from mwd_estimation.nodes.estimator import LiveRevisions
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station import station
from mwd_estimation.survey.survey import ROTARY

STATION = dataclasses.replace(
    station(np.array([-9.0, 0.5, 3.8]), np.array([2.3e-5, -1.5e-5, 4.0e-5])), verdict="accept"
)


def survey(number, **changes):
    mean = Average(np.full(6, float(number)), np.eye(6), 100)
    still = StillAverage((number - 5) * 10**9, (number + 5) * 10**9, mean, None, None, 20.0, requested=False)
    given = DecidedSurvey(still, number, STATION)
    return dataclasses.replace(given, **changes)


@pytest.fixture
def live():
    """Revisions of a run whose later stations say what `says` holds; everything published is in `published`."""
    published = []
    live = LiveRevisions(lambda one, frame: published.append((one, frame)))
    run = SimpleNamespace(says={}, published=published)
    run.judging_again = lambda _newest: lambda: dict(run.says)

    def judge(number, withdrawn=False, **says):
        run.says = {
            int(name[1:]): survey(int(name[1:]), station=one, withdrawn=withdrawn) for name, one in says.items()
        }
        live.take(survey(number), run, "sonde_link")
        until = time.monotonic() + 60.0
        live.update()
        while (live._job or live._waiting) and time.monotonic() < until:
            time.sleep(0.01)
            live.update()
        assert (live._job, live._waiting) == (None, None)

    run.judge, run.live = judge, live
    yield run
    live.close()


def published(live):
    """Sequence, revision and verdict of the published surveys, and whether each is withdrawn."""
    return [(one.sequence, one.revision, one.station.verdict, one.withdrawn) for one, _ in live.published]


def test_a_changed_verdict_is_published_once_and_counts_and_may_go_back_to_the_first_one(live):
    live.judge(1)
    for number, verdict in ((2, "doubtful"), (3, "doubtful"), (4, "reject"), (5, "accept")):
        live.judge(number, s1=dataclasses.replace(STATION, verdict=verdict))
    assert published(live) == [(1, 1, "doubtful", False), (1, 2, "reject", False), (1, 3, "accept", False)]
    assert {frame for _, frame in live.published} == {"sonde_link"}
    assert live.published[0][0].uuid == survey(1).uuid


def test_a_rotary_survey_is_no_station_of_the_run(live):
    live.live.take(survey(1, kind=ROTARY), live, "sonde_link")
    live.live.update()
    assert live.live._job is None


def test_a_survey_is_withdrawn_once_and_comes_back_when_the_fault_has_gone(live):
    for number in (1, 2):
        live.judge(number, s1=dataclasses.replace(STATION, verdict="reject"), withdrawn=True)
    live.judge(3)
    live.judge(4)
    assert published(live) == [(1, 1, "reject", True), (1, 2, "accept", False)]


def test_what_is_still_to_be_revised_is_published_before_the_estimator_stops(live):
    live.says = {1: survey(1, station=dataclasses.replace(STATION, verdict="reject"))}
    live.live.take(survey(1), live, "sonde_link")
    live.live.finish()
    assert published(live) == [(1, 1, "reject", False)]
