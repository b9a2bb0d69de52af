# SPDX-License-Identifier: Apache-2.0
"""The survey list of the node: what the estimator says later of a survey stands beside its first value."""

import concurrent.futures
import dataclasses
import logging
import math
from types import SimpleNamespace

import example_surveys as example
import pytest

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core.unknown import or_none
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.well_clock import WellClock
from mwd_surface.live.well_context import WellContext, WellOutlet
from mwd_surface.nodes.rod_server import RodServer
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.nodes.survey_list_server import SurveyListServer
from mwd_surface.page.state_json import survey_row
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.surveys.depth import DepthTrack
from mwd_surface.surveys.leg import MAIN
from mwd_surface.surveys.leg_settings import LegSettings
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.message_conversion import list_of
from mwd_surface.surveys.rods import RodSettings
from mwd_surface.surveys.station_checks import revision_doubt
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Value
from mwd_surface.trajectory.plan import plan_of


class Log:
    """The alarm log without a node."""

    def __init__(self):
        self.events, self.standing = [], {}

    def log_event(self, source, text, severity=Severity.INFO):
        self.events.append((source, text, severity))

    def raise_alarm(self, alarm_id, severity, text, *_):
        self.events.append((alarm_id, text, severity))
        self.standing[alarm_id] = (severity, text)

    def clear_alarm(self, alarm_id):
        self.standing.pop(alarm_id, None)

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
    yield SimpleNamespace(server=server, context=context, published=published, events=log.events, log=log)
    server.close()


def test_an_operator_opens_a_branch_and_returns_to_the_main_leg(server):
    book, node = server.server, server.context.node
    for k, depth in enumerate((500.0, 530.0), start=1):
        book.depth.set_by_hand(example.survey(k, 10.0, 40.0).stamp_ns, depth)
        book.on_survey(example.survey(k, 10.0, 40.0))

    def set_parameters_atomically(parameters):
        values = {one.name.removeprefix("leg."): one.value for one in parameters}
        values["kick_off_depth"] = or_none(values["kick_off_depth"])
        node.settings = dataclasses.replace(node.settings, leg=dataclasses.replace(node.settings.leg, **values))
        book.change_settings(node.settings.well, node.settings.rules, node.settings.leg, None)
        return SimpleNamespace(successful=True)

    node.settings = SurfaceSettings(well=example.WELL, leg=LegSettings(tie_on_depth=0.0))
    node.set_parameters_atomically = set_parameters_atomically
    assert not book.use_leg(leg="branch 1", operator_name="Ann")[0], "no depth"
    assert not book.use_leg(leg="branch 1", operator_name="Ann", kick_off_depth=5000.0)[0], "not on the path"
    assert book.surveys.leg == MAIN
    assert book.use_leg(leg="branch 1", operator_name="Ann", kick_off_depth=200.0)[0]
    assert book.surveys.leg == "branch 1"
    assert book.surveys.legs[-1].tie_on.measured_depth == 200.0
    assert book.use_leg(leg=MAIN, operator_name="Ann")[0]
    assert book.surveys.leg == MAIN
    assert "Ann" in server.events[-1][1]


def decide(service, **fields):
    given = {"sequence": 1, "operator_name": "Ann", "reason": "", "measured_depth": math.nan, "replace": False}
    request = SimpleNamespace(**given | {"value": int(Value.DEFINITIVE)} | fields)
    return service(request, SimpleNamespace(success=False, message=""))


def test_a_revision_is_applied_published_shown_logged_and_told_by_an_alarm_of_low_priority(server):
    first = example.survey(1, 10.0, 40.0)
    server.server.on_survey(first)
    assert server.server.surveys.records[0].in_use
    accepted = len(server.published["survey/accepted"])
    moved = dataclasses.replace(first, azimuth=first.azimuth + 0.1, revision=1)
    for _ in range(2):
        server.server.on_revision(moved)
    assert len(server.published["surveys"]) == 2
    (record,) = server.published["surveys"][-1].records
    assert (record.survey.revision, record.first[0].revision, record.revised, record.in_use) == (1, 0, [], True)
    row = survey_row(server.server.surveys.records[0], North.GRID)
    assert row["first"]["azimuth"] == pytest.approx(first.azimuth_from(North.GRID))
    assert row["azimuth"] == pytest.approx(moved.azimuth_from(North.GRID))
    # Clients of the accepted surveys learn the new value, and the words say how far the path moves.
    assert len(server.published["survey/accepted"]) == accepted + 1
    (told,) = [text for source, text, _ in server.events if "revised from" in text]
    assert "the well path moves" in told
    assert server.log.standing == {"survey.revised": (Severity.INFO, told)}
    # One that makes it doubtful takes it out of the path.
    doubtful = dataclasses.replace(moved, verdict=int(Verdict.DOUBTFUL), headline="steel", revision=2)
    server.server.on_revision(doubtful)
    assert not server.published["surveys"][-1].records[0].in_use
    assert "the survey leaves the path" in server.log.standing["survey.revised"][1]
    # The alarm stands until the next survey.
    server.server.on_survey(example.survey(2, 10.0, 40.0))
    assert "survey.revised" not in server.log.standing


def test_the_alarm_of_a_refused_survey_ends_with_the_next_survey_that_the_list_takes(server):
    server.server.on_survey(dataclasses.replace(example.survey(1, 10.0, 40.0), inclination=math.nan))
    assert server.log.standing["survey.refused"][0] == Severity.WARNING
    server.server.on_survey(example.survey(2, 10.0, 40.0))
    assert "survey.refused" not in server.log.standing


@pytest.mark.fault_case(86)
def test_a_decision_with_an_unknown_kind_of_value_is_refused_by_the_name_of_the_field(server):
    server.server.on_survey(example.survey(1, 10.0, 40.0))
    before = server.server.surveys
    answer = decide(server.server.accept, value=77)
    assert not answer.success
    assert answer.message.startswith("value: ")
    assert server.server.surveys is before


@pytest.mark.parametrize("end", ["accepted", "rejected", "revised", "next survey"])
@pytest.mark.parametrize("verdict", [Verdict.DOUBTFUL, Verdict.REJECT])
def test_the_alarm_of_a_doubtful_azimuth_ends_with_the_doubt(server, verdict, end):
    sound = example.survey(1, 10.0, 40.0)
    doubtful = dataclasses.replace(sound, verdict=int(verdict), verdict_azimuth=int(verdict), headline="steel")
    server.server.on_survey(doubtful)
    severity = Severity.CRITICAL if verdict == Verdict.REJECT else Severity.WARNING
    assert server.log.standing["survey.azimuth"][0] == severity
    if end in ("accepted", "rejected"):
        service = server.server.accept if end == "accepted" else server.server.reject
        assert decide(service, reason="measured again").success
    elif end == "revised":
        server.server.on_revision(dataclasses.replace(sound, revision=1))
    else:
        server.server.on_survey(example.survey(2, 10.0, 40.0))
    assert "survey.azimuth" not in server.log.standing


@pytest.mark.parametrize("verdict", [Verdict.ACCEPT, Verdict.DOUBTFUL])
def test_a_value_of_a_person_that_later_surveys_contradict_is_an_alarm_until_a_person_decides(server, verdict):
    first = example.survey(1, 10.0, 40.0)
    server.server.on_survey(first)
    assert decide(server.server.accept).success
    near = dataclasses.replace(first, azimuth=first.azimuth + 0.5 * first.sigma_azimuth, revision=1)
    server.server.on_revision(near)
    assert server.log.standing == {}
    far = dataclasses.replace(first, azimuth=first.azimuth + 0.1, verdict=int(verdict), headline="steel")
    for revision in (2, 3):
        server.server.on_revision(dataclasses.replace(far, revision=revision))
        ((key, (severity, text)),) = server.log.standing.items()
        assert (key, severity) == ("survey.contradicted.1", Severity.CRITICAL)
        assert revision_doubt(server.server.surveys.records[0], North.GRID) == text
        # A decision holds for the revisions that were known: the next one asks again.
        assert decide(server.server.accept).success
        assert server.log.standing == {}
    server.server.on_revision(dataclasses.replace(far, azimuth=first.azimuth + 0.2, revision=4))
    assert server.log.standing
    assert decide(server.server.accept, value=int(Value.REVISED)).success
    assert server.log.standing == {}
    assert server.server.surveys.records[0].survey.revision == 4


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


def test_rods_set_the_bit_depth_and_their_tally_outlives_the_node(server):
    settings = RodSettings(1.5, 501.0)
    rods = RodServer(server.context, settings, server.server)
    for _ in range(3):
        done, words = rods.count(change=1, operator_name="Li")
        assert done, words
    assert rods.count(change=1, length=0.75, operator_name="Li")[1] == "4 rods in the hole, bit depth 506.25 m"
    assert rods.count(change=-1, operator_name="Li")[0]
    assert server.server.bit_depth == pytest.approx(505.5)
    # A recording has each depth as one set by hand.
    assert [one.depth for one in server.published["operator_events"]] == [502.5, 504.0, 505.5, 506.25, 505.5]
    again = RodServer(server.context, settings, server.server)
    assert again.tally == rods.tally
    assert server.context.live.at(0.0).rods.rods == 3


def test_after_a_restart_the_depth_by_rods_is_in_force_from_the_time_of_the_last_change(server):
    settings, told = RodSettings(1.5, 501.0), []
    RodServer(server.context, settings, server.server).count(change=1, operator_name="Li")
    server.server.on_depth_by_hand = lambda *given: told.append(given)
    server.log.now_ns = lambda: example.MADE + 40 * 10**9
    # A depth that has come already stays in force.
    RodServer(server.context, settings, server.server).begin()
    assert told == []
    server.server.depth = DepthTrack()
    RodServer(server.context, settings, server.server).begin()
    assert server.server.depth.latest == (example.MADE, 502.5)
    assert server.server.depth.sensor_depth(example.MADE + 10**9, 2.5).measured_depth == pytest.approx(500.0)
    assert told == [(502.5, 40.0)]
    event = server.published["operator_events"][-1]
    assert (event.depth, event.operator_name, event.success) == (502.5, "Li", True)
    # A clock that was set back puts no depth into the future.
    server.server.depth = DepthTrack()
    server.log.now_ns = lambda: example.MADE - 10**9
    RodServer(server.context, settings, server.server).begin()
    assert server.server.depth.latest == (example.MADE - 10**9, 502.5)


def test_a_depth_by_rods_that_is_too_deep_is_an_alarm_at_the_start(server):
    server.server.depth = DepthTrack()
    (server.context.folder / "surveys" / "rods.csv").write_text("1,,correct,30,5000,0,Li,counted\n")
    RodServer(server.context, RodSettings(30.0, 0.0), server.server).begin()
    assert server.server.bit_depth is None
    assert "rods.log" in server.log.standing


@pytest.mark.parametrize("torn", ["李".encode()[:1], b'1,2,add,1.5,9,20.0,"Li', b"\0\0\n"])
def test_a_torn_log_of_rods_is_an_alarm_until_the_tally_is_corrected(server, torn):
    settings = RodSettings(1.5, 501.0)
    path = server.context.folder / "surveys" / "rods.csv"
    RodServer(server.context, settings, server.server).count(change=1, operator_name="李")
    path.write_bytes(path.read_bytes() + torn)
    rods = RodServer(server.context, settings, server.server)
    assert len(rods.tally.lengths) == 1
    assert "rods.log" in server.log.standing
    rods.count(change=1, operator_name="李")
    assert "rods.log" in server.log.standing
    rods.count(count=4, operator_name="李", reason="counted")
    assert "rods.log" not in server.log.standing
    again = RodServer(server.context, settings, server.server)
    assert again.tally == rods.tally
    assert "rods.log" not in server.log.standing


def test_a_log_of_rods_that_cannot_be_read_is_an_alarm_and_the_node_starts(server):
    (server.context.folder / "surveys" / "rods.csv").mkdir()
    rods = RodServer(server.context, RodSettings(1.5, 501.0), server.server)
    assert "rods.log" in server.log.standing
    assert rods.count(change=1, operator_name="Li")[0]
    assert "rods.unsaved" in server.log.standing


def test_the_answer_to_a_change_that_is_not_on_disk_says_so_until_it_is_stored(server):
    book, node, folder = server.server, server.context.node, server.context.folder / "surveys"
    node.settings = SurfaceSettings(well=example.WELL, leg=LegSettings(tie_on_depth=0.0))
    node.set_parameters_atomically = lambda _: SimpleNamespace(successful=True)
    rods = RodServer(server.context, RodSettings(1.5, 501.0), book)
    changes = {
        "accept": lambda: decide(book.accept).message,
        "reject": lambda: decide(book.reject, reason="steel").message,
        "leg": lambda: book.use_leg(leg=MAIN, operator_name="Ann")[1],
        "rods": lambda: rods.count(change=1, operator_name="Ann")[1],
    }
    book.on_survey(example.survey(1, 10.0, 40.0))
    for name, change in changes.items():
        assert "not on disk" not in change(), name
    # A folder in the place of the file makes each attempt to write fail, as a full disk does.
    (folder / "surveys.writing.json").mkdir()
    (folder / "rods.csv").rename(folder / "kept.csv")
    (folder / "rods.csv").mkdir()
    for name, change in changes.items():
        assert "not on disk" in change(), name
    (folder / "surveys.writing.json").rmdir()
    (folder / "rods.csv").rmdir()
    book.retry_save()
    for name, change in changes.items():
        assert "not on disk" not in change(), name


def test_a_rod_without_a_survey_and_a_tally_beside_the_rig_are_told(server):
    rods = RodServer(server.context, RodSettings(1.5, 501.0), server.server)
    rods.count(change=1, operator_name="Li")
    rods.count(change=1, operator_name="Li")
    assert any("no survey since rod 1" in text for _, text, _ in server.events)
    server.events.clear()
    server.server.on_survey(example.survey(1, 10.0, 40.0))
    rods.count(change=1, operator_name="Li")
    assert not any("no survey" in text for _, text, _ in server.events)
    assert server.log.standing == {}
    rods.rig_depth = lambda: 508.5
    rods.count(change=1, operator_name="Li")
    assert "too few rods" in server.log.standing["rods.apart"][1]
    assert rods.count(count=5, operator_name="Li", reason="one was not told")[0]
    assert "rods.apart" not in server.log.standing
    assert any("corrected from 4 to 5 rods, Li" in text for _, text, _ in server.events)


def test_a_rod_that_is_drilled_down_or_pulled_raises_no_alarm_and_one_that_was_not_told_does(server):
    rods = RodServer(server.context, RodSettings(1.5, 501.0), server.server)

    def alarm(depth, change=None):
        rods.rig_depth = lambda: depth
        if change is not None:
            assert rods.count(change=change, operator_name="Li")[0]
        rods.update()
        return "rods.apart" in server.log.standing

    # Each rod is told at its end; meanwhile the bit is up to a rod deeper than the tally.
    for k in range(1, 4):
        assert not any(alarm(501.0 + 1.5 * (k - 1) + ahead) for ahead in (0.0, 0.7, 1.4, 1.5))
        assert not alarm(501.0 + 1.5 * k, change=1)
    # So does a rod that is pulled, before it is told.
    assert not alarm(504.0)
    assert not alarm(504.0, change=-1)
    # A rod that was not told: at the latest when the next one is told, for as long as it lasts.
    assert alarm(507.0, change=1)
    assert alarm(507.8)
    assert rods.count(count=4, operator_name="Li", reason="one was not told")[0]
    assert not alarm(507.0)
    # A rod told when it is screwed on is ahead of the bit, until it has been drilled down.
    assert alarm(507.0, change=1)
    assert not alarm(508.2)
    # The alarm comes and goes with the depth of the rig, without a change of the tally.
    assert alarm(560.0)
    assert not alarm(None)
    assert alarm(560.0)
    assert not alarm(508.5)


@pytest.mark.parametrize(
    "wrong",
    [{}, {"change": 2}, {"change": 1, "count": 4}, {"count": -3, "reason": "x"}, {"count": 3}, {"change": -1}],
)
def test_a_wrong_request_changes_no_depth(server, wrong):
    rods = RodServer(server.context, RodSettings(1.5, 501.0), server.server)
    before = server.server.bit_depth
    done, why = rods.count(operator_name="Li", **wrong)
    assert not done
    assert why
    assert server.server.bit_depth == before
    assert not RodServer(server.context, RodSettings(), server.server).count(change=1, operator_name="Li")[0]
