# SPDX-License-Identifier: Apache-2.0
"""The survey list of the node: what the estimator says later of a survey stands beside its first value."""

import concurrent.futures
import dataclasses
import logging
import math
from types import SimpleNamespace

import example_surveys as example
import pytest
from mwd_msgs import msg

from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext, WellOutlet
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.nodes.survey_list_server import SurveyListServer
from mwd_surface.page.survey_panel import survey_row
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.surveys.leg_settings import LegSettings
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.message_conversion import list_of, survey_of
from mwd_surface.surveys.station_checks import revision_doubt
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Verdict
from mwd_surface.trajectory.north import North
from mwd_surface.trajectory.plan import plan_of


class Log:
    """The alarm log without a node."""

    def __init__(self):
        self.events, self.standing = [], {}

    def log_event(self, source, text, severity=Severity.INFO):
        self.events.append((source, text, severity))

    def raise_alarm(self, alarm_id, severity, text, *_):
        self.events.append((alarm_id, text, severity))

    def clear_alarm(self, alarm_id):
        """No alarm stands here."""

    def set_alarms(self, prefix, causes):
        self.standing = {key: cause for key, cause in self.standing.items() if not key.startswith(prefix)}
        self.standing |= {key: (severity, text) for key, (severity, text, _) in causes.items()}
        assert all(key.startswith(prefix) for key in causes)

    def now_ns(self):
        return example.MADE


class Worker:
    """Runs no report and no ellipse: they are not looked at here."""

    def submit(self, *_):
        return concurrent.futures.Future()


def nothing(*_):
    """What is not looked at here."""


@pytest.fixture
def server(tmp_path):
    published = {}

    def add_publisher(_kind, topic, _qos):
        return SimpleNamespace(publish=lambda message: published.setdefault(topic, []).append(message))

    node = SimpleNamespace(
        add_publisher=add_publisher,
        add_service=nothing,
        frame=lambda name: name,
        get_logger=lambda: logging.getLogger("surface"),
    )
    outlet, log = WellOutlet(), Log()
    outlet.run = nothing
    well = WellContext(WellClock(example.MADE), LiveState(), log, outlet)
    context = SurfaceContext(node, tmp_path, well, Worker(), requests=None)
    server = SurveyListServer(
        context,
        SurfaceSettings(well=example.WELL, leg=LegSettings(tie_on_depth=0.0)),
        plan=SimpleNamespace(plan=None, show_offset=nothing),
    )
    server.slide_sheet, server.on_depth_by_hand = tuple, nothing
    outlet.on_surveys, outlet.on_accepted = server.publish, server.publish_accepted
    server.open()
    server.depth.set_by_hand(example.survey(1, 10.0, 40.0).stamp_ns, 500.0)
    yield SimpleNamespace(server=server, published=published, events=log.events, log=log)
    server.close()


def test_a_revision_is_listed_published_shown_and_logged_and_moves_no_station(server):
    first = example.survey(1, 10.0, 40.0)
    server.server.on_survey(first)
    (before,) = server.published["surveys"][-1].records
    later = dataclasses.replace(first, azimuth=first.azimuth + 0.1, verdict=int(Verdict.DOUBTFUL), headline="steel")
    for revision in (1, 1):
        server.server.on_revision(dataclasses.replace(later, revision=revision))
    assert len(server.published["surveys"]) == 2
    (record,) = server.published["surveys"][-1].records
    assert survey_of(record.survey) == survey_of(before.survey)
    assert record.in_use == before.in_use
    assert [(one.revision, one.verdict) for one in record.revised] == [(1, msg.Survey.DOUBTFUL)]
    row = survey_row(server.server.surveys.records[0], North.GRID)
    assert row["revised"] == "doubtful"
    assert any(flag.startswith("later surveys say: doubtful") and "steel" in flag for flag in row["flags"])
    said = [(text, severity) for source, text, severity in server.events if "later surveys say" in text]
    assert len(said) == 1
    assert said[0][1] == (Severity.WARNING if before.in_use else Severity.INFO)


@pytest.mark.parametrize("verdict", [Verdict.ACCEPT, Verdict.DOUBTFUL])
def test_a_value_in_use_that_later_surveys_contradict_is_an_alarm_until_a_person_decides(server, verdict):
    first = example.survey(1, 10.0, 40.0)
    server.server.on_survey(first)
    assert server.server.surveys.records[0].in_use
    near = dataclasses.replace(first, azimuth=first.azimuth + 0.5 * first.sigma_azimuth, revision=1)
    server.server.on_revision(near)
    assert server.log.standing == {}

    def decide(service):
        request = SimpleNamespace(sequence=1, operator_name="Ann", reason="", measured_depth=math.nan, replace=False)
        return service(request, SimpleNamespace(success=False, message=""))

    far = dataclasses.replace(first, azimuth=first.azimuth + 0.1, verdict=int(verdict), headline="steel")
    for revision in (2, 3):
        server.server.on_revision(dataclasses.replace(far, revision=revision))
        ((key, (severity, text)),) = server.log.standing.items()
        assert (key, severity) == ("survey.revised.1", Severity.CRITICAL)
        assert "in use with azimuth 40.00 deg" in text
        assert f"later surveys say azimuth 45.73 deg, {verdict.word}" in text
        assert revision_doubt(server.server.surveys.records[0], North.GRID) == text
        # What he decides holds for what he knew: the next revision asks him again.
        assert decide(server.server.accept).success
        assert server.log.standing == {}
    server.server.on_revision(dataclasses.replace(far, azimuth=first.azimuth + 0.2, revision=4))
    assert server.log.standing
    assert decide(server.server.reject).success
    assert server.log.standing == {}


def test_a_revision_that_says_no_more_than_the_value_in_use_raises_no_alarm():
    doubtful = dataclasses.replace(example.survey(1, 10.0, 40.0), verdict=int(Verdict.DOUBTFUL))
    upright = dataclasses.replace(example.survey(2, 0.5, 40.0), north=int(North.UNKNOWN))
    for first in (doubtful, upright):
        record = SurveyList(well=example.WELL).add(first, 300.0, 0.0).records[0]
        record = dataclasses.replace(record, in_use=True)
        later = dataclasses.replace(first, azimuth=first.azimuth + 0.3 * first.sigma_azimuth, revision=3)
        assert revision_doubt(dataclasses.replace(record, revised=(later,)), North.GRID) == ""
        known = dataclasses.replace(later, verdict=int(Verdict.REJECT))
        assert revision_doubt(dataclasses.replace(record, revised=(known,)), North.GRID)
        other = North.UNKNOWN if first.has_azimuth else North.GRID
        found = dataclasses.replace(later, north=int(other))
        assert revision_doubt(dataclasses.replace(record, revised=(found,)), North.GRID)


def test_a_revision_of_a_survey_that_is_not_listed_changes_nothing(server):
    server.server.on_revision(dataclasses.replace(example.survey(9, 10.0, 40.0), revision=1))
    assert "surveys" not in server.published


def test_a_path_without_a_tie_on_raises_an_alarm_until_one_is_given_and_the_plan_goes_out_with_the_list(server):
    listed = server.server
    plan = plan_of([0.0, 300.0, 900.0], [0.0, 0.0, 0.7], [0.8, 0.8, 0.9], name="plan B")
    listed.surveys = SurveyList(well=example.WELL)
    listed.on_survey(example.survey(1, 10.0, 40.0))
    assert "path.assumed.hole_above_assumed" in server.log.standing
    path = server.published["trajectory"][-1]
    assert path.first_is_assumed
    assert "no tie-on is given" in path.assumptions[0]
    well = dataclasses.replace(example.WELL, section_azimuth_deg=None)
    listed.change_settings(well, ListRules(), LegSettings(tie_on_depth=0.0), plan)
    assert not server.log.standing
    path, sent = server.published["trajectory"][-1], server.published["surveys"][-1]
    assert (path.first_is_assumed, path.assumptions) == (False, [])
    assert list_of(sent, well).plan == plan
    assert listed.definitive().section_azimuth == plan.section_azimuth
    # The plan does not change a section azimuth that is set.
    listed.change_settings(dataclasses.replace(well, section_azimuth_deg=75.0), ListRules(), LegSettings(), plan)
    assert math.degrees(listed.definitive().section_azimuth) == pytest.approx(75.0)
    assert listed.surveys.plan == plan
