# SPDX-License-Identifier: Apache-2.0
"""Three real nodes as the launch file starts them: surveys, services, page, recording, ends, the same bits again."""

import asyncio
import contextlib
import dataclasses
import json
import math
import signal
import socket
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from test_foxglove_graph import watch

import running_graph
from invoked_command import invoke
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.core.settings import changed
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.cli import app
from mwd_surface.rig.modbus.map import StatusBit
from mwd_surface.rig.status import FILE_NAME, read_status
from mwd_surface.surveys.survey_source import surveys_of
from project import ROOT
from recorded_launch import processes
from running_graph import CALL, LOOK, PLACE, messages_of, samples_of, until

SCENARIO = Path(__file__).parent / "scenarios" / "short.yaml"
TOKEN = "a-long-secret"  # noqa: S105
LISTENS = {"enabled": True, "port": 0}
pytestmark = [pytest.mark.ros, pytest.mark.slow(2)]


class Talk:
    """
    A node of the test on the graph's domain, in a process of its own because a process has one domain for good.

    It joins the graph when its first answer is asked for; what it imports is there by then.
    """

    def __init__(self, graph, script):
        self.log = graph.folder / "talk.log"
        with self.log.open("w") as log:
            self._process = graph.running["talk"] = subprocess.Popen(
                [sys.executable, "-c", script],
                env=graph.environment,
                text=True,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
            )

    def first(self):
        """Return its first answer."""
        print(file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        assert line, self.log.read_text()
        return json.loads(line)

    def last(self):
        """Return its last answer, with which it ends."""
        out, _ = self._process.communicate("\n", timeout=720)
        assert self._process.returncode == 0, self.log.read_text()
        return json.loads(out.splitlines()[-1])


TALK = (
    CALL
    + """
import functools, json, math, time
from rclpy.parameter import Parameter
from rcl_interfaces.srv import SetParametersAtomically, DescribeParameters
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from mwd_msgs.msg import Attitude, Gravity, SurveyList
from sensor_msgs.msg import Imu, MagneticField
from mwd_msgs.srv import JudgeSurvey, SetDepth, SetReferenceField, InjectFault, Export
from mwd_sensors.ros import qos
input()
rclpy.init(); node = rclpy.create_node("talk"); reported = {}
call = functools.partial(call, node)
got, plain = [], {}
node.create_subscription(SurveyList, "/w1/surveys", got.append, qos.LATCHED)
for name, kind in (("imu/data_raw", Imu), ("imu/mag", MagneticField), ("attitude", Attitude), ("gravity", Gravity)):
    node.create_subscription(kind, f"/w1/{name}", lambda _message, name=name: plain.setdefault(name, 1), 10)
end = time.monotonic() + 60
while (not got or len(plain) < 4) and time.monotonic() < end: rclpy.spin_once(node, timeout_sec=0.1)
reported["with the default profile"] = sorted(plain)
reported["late joiner sees"] = len(got[0].records)
def set_all(target, **values):
    parameters = [Parameter(k.replace("__", "."), value=v).to_parameter_msg() for k, v in values.items()]
    result = call(SetParametersAtomically, f"/w1/{target}/set_parameters_atomically", parameters=parameters).result
    return result.successful, result.reason
reported["good set"] = set_all("surface", rules__gap_limit=80.0, well__rig="Rig 7")
reported["bad plan"] = set_all("surface", plan__file="no/such.csv", advisory__toolface_deg=-1.0)
reported["bad set"] = set_all("estimator", survey__settle_s=1.0, survey__duration_s=1000.0)
reported["fixed set"] = set_all("sonde", rate=5.0)
found = call(DescribeParameters, "/w1/estimator/describe_parameters", names=["survey.duration_s"]).descriptors[0]
reported["description"] = [found.description, found.floating_point_range[0].to_value]
reported["state"] = call(GetState, "/w1/estimator/get_state").current_state.label
judged = dict(sequence=1, reason="looks odd", measured_depth=math.nan)
reported["nameless"] = call(JudgeSurvey, "/w1/reject_survey", **judged).message
reported["rejected"] = call(JudgeSurvey, "/w1/reject_survey", operator_name="Ann", **judged).success
reported["accepted"] = call(JudgeSurvey, "/w1/accept_survey", operator_name="Bob", **judged).success
reported["nan depth"] = call(SetDepth, "/w1/set_depth", bit_depth=math.nan, operator_name="Ann").message
reported["bad field"] = call(SetReferenceField, "/w1/set_reference_field", total=50000.0, dip=1.0, source="pad").message
reported["fault"] = call(InjectFault, "/w1/inject_fault", component="mag", fault="stuck").message
reported["export"] = call(Export, "/w1/export", format="csv").path
print(json.dumps(reported), flush=True)
node.destroy_node()

input()
call = functools.partial(call.func, rclpy.create_node("talk_again"))
transition = Transition(id=Transition.TRANSITION_ACTIVE_SHUTDOWN)
print(json.dumps(call(ChangeState, "/w1/sonde/change_state", transition=transition).success), flush=True)
"""
)


def take_survey(page):
    """Whether a person who asks for a survey on a page is answered."""
    headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"}
    asked = urllib.request.Request(f"{page}command/take_survey", b"{}", headers)  # noqa: S310  (loopback)
    # The estimator's service may not be known yet.
    with (
        contextlib.suppress(urllib.error.HTTPError),
        urllib.request.urlopen(asked, timeout=10.0) as answer,  # noqa: S310
    ):
        return json.load(answer)["ok"]
    return False


def parameters(folder):
    """Parameters of each node of the run."""
    plan = folder / "plan.csv"
    plan.write_text("md_m,inc_deg,azi_true_deg\n0,30,40\n60,36,47\n300,60,50\n")
    surface = {"folder": str(folder / "data"), "page.port": 0, "well.sensor_to_bit": 3.0, "record.name": "run"}
    # The hole of the scenario, which is not vertical at the wellhead.
    surface |= {"leg.tie_on_depth": 0.0, "leg.tie_on_inclination_deg": 30.0, "leg.tie_on_azimuth_deg": 40.0}
    surface |= {"plan.file": str(plan), "advisory.toolface_deg": 30.0}
    surface |= {f"{name}.{key}": value for name in ("rig.modbus", "foxglove") for key, value in LISTENS.items()}
    sonde = {"scenario": str(SCENARIO), "wait_for_listener_s": 60.0, "fault_injection": False}
    return {"surface": surface, "estimator": PLACE, "sonde": sonde}


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A whole run of the short scenario with everything asked of it on the way."""
    folder = tmp_path_factory.mktemp("graph")
    file = folder / "parameters.yaml"
    given = {node: {"ros__parameters": settings} for node, settings in parameters(folder).items()}
    file.write_text(yaml.safe_dump({"/**": given}))
    launch = ROOT / "mwd_surface" / "launch" / "mwd.launch.py"
    described = processes(launch, source="simulated", namespace="w1", params_file=str(file))
    words = {one.executable: one.words for one in described.processes}
    with running_graph.graph(folder) as graph:
        graph.environment = {**described.environment, **graph.environment, "MWD_PAGE_TOKEN": TOKEN}
        surface, estimator = (graph.start(node, arguments=words[node]) for node in ("surface", "estimator"))
        graph.active(surface, estimator)
        talk, facts = Talk(graph, TALK), {}

        def address(server):
            return until(lambda: graph.log(surface).partition(f"{server}: ")[2].split()[:1], 20, server)[0]

        page, viewer = address("page"), address("foxglove")

        def shown(section):
            return running_graph.sections(page).get(section, {})

        until(lambda: take_survey(page), 30, "the estimator's service is there", LOOK)
        facts["without sonde"] = until(lambda: shown("survey_progress").get("result"), 20, "a result", LOOK)
        sonde = graph.start("sonde", arguments=words["sonde"])
        facts["taking"] = until(lambda: (now := shown("survey_progress")).get("active") and now, 60, "a survey", LOOK)
        facts["viewed"], times = asyncio.run(watch(viewer, "/w1/imu/data_raw", 200))
        assert times == []
        until(lambda: "survey 1 in use" in graph.log(surface), 90, "first survey")
        until(lambda: shown("surveys")["rows"], 10, "the survey is on the page", LOOK)
        until(lambda: "survey 1" in shown("survey_progress")["result"], 10, "what came of the survey", LOOK)
        facts["page"] = running_graph.sections(page)
        facts["reported"] = talk.first()
        facts["rig file"] = folder / "data" / "w1" / FILE_NAME
        facts["rig"], facts["asked"] = read_status(facts["rig file"]), time.time()
        facts["modbus status"] = _modbus_status(facts["rig"].interfaces[0].address)

        def without_plan():
            alarmed = any(alarm["id"] == "plan.file" for alarm in shown("alarms")["rows"])
            return running_graph.sections(page) if alarmed and not shown("plan")["name"] else None

        # Files are read beside the node's work.
        facts["page without plan"] = until(without_plan, 20, "the page without plan", LOOK)
        until(lambda: "scenario is over" in graph.log(sonde), 90, "the scenario is over")
        until(lambda: "survey: survey 2" in graph.log(surface), 30, "second survey")
        facts["shut down"] = talk.last()
        began = time.monotonic()
        facts["ends"] = {"sonde": (graph.wait(sonde, 20.0), time.monotonic() - began)}
        facts["ends"]["estimator"] = graph.end(estimator, signal.SIGTERM)
        # Once no survey can come any more: the recording encloses no report of a list that has changed since.
        until(lambda: is_reported(graph.log(surface)), 60, "the report of the whole list")
        facts["ends"]["surface"] = graph.end(surface)
        facts["logs"] = graph.log(surface) + graph.log(estimator) + graph.log(sonde)
        facts["bag"] = folder / "data" / "w1" / "bags" / "run"
        yield facts


def is_reported(log):
    """Whether a report was made after the last survey."""
    return log.rfind("report of") > log.rfind("survey: survey")


@pytest.mark.fault_case(60)
def test_every_node_ends_in_order_and_in_time(played):
    assert played["shut down"]
    assert {status for status, _ in played["ends"].values()} == {0}
    assert max(seconds for _, seconds in played["ends"].values()) < 15.0
    assert "Traceback" not in played["logs"]


@pytest.mark.fault_case(54)
def test_a_late_joiner_sees_the_survey_table_and_the_page_shows_it(played):
    assert played["reported"]["late joiner sees"] == 1
    assert len(played["page"]["surveys"]["rows"]) == 1
    assert played["page"]["attitude"]["inclination"]["state"] == "live"


def test_the_page_shows_plan_offset_advice_reference_field_and_progress(played):
    sections = played["page"]
    assert sections["plan"]["name"] == "plan.csv"
    assert len(sections["plan"]["north"]) > 20
    # The simulated hole starts at the wellhead of the plan.
    assert sections["offset"]["distance"] < 20.0
    assert sections["offset"]["dogleg_to_target"] > 0.0
    assert math.degrees(sections["toolface"]["advisory"]["toolface"]) == pytest.approx(30.0)
    assert math.degrees(sections["well"]["section_azimuth"]) == pytest.approx(49.0, abs=2.0)
    assert 5.2e-5 < sections["well"]["field"]["total"] < 5.7e-5
    assert "WMM" in sections["well"]["field"]["source"]
    assert sections["survey_progress"]["result"] == "survey 1: accept"
    assert played["taking"]["remaining"] > 0.0
    assert played["taking"]["state"] in ("letting the string settle", "averaging")


@pytest.mark.fault_case(40)
def test_a_plan_that_cannot_be_read_is_an_alarm_and_the_page_goes_on_without(played):
    assert played["reported"]["bad plan"][0]
    sections = played["page without plan"]
    assert sections["plan"]["name"] == ""
    assert sections["offset"] is None
    assert sections["toolface"]["advisory"] is None
    assert any(a["id"] == "plan.file" and "no/such.csv" in a["text"] for a in sections["alarms"]["rows"])


def test_a_survey_that_is_not_granted_says_why_under_survey(played):
    assert played["without sonde"] == "no survey taken: no samples arrive from the sonde"
    # The threshold between the toolfaces is the estimator's.
    assert played["page"]["toolface"]["threshold"]


@pytest.mark.fault_case(87)
def test_a_taken_port_is_an_alarm_and_the_page_comes_once_it_is_free(tmp_path):
    with running_graph.graph(tmp_path) as graph, socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        common = {"page__port": port, "record__enabled": False}
        strict = graph.start("surface", "strict", folder=tmp_path / "strict", strict=True, **common)
        surface = graph.start("surface", "w1", folder=tmp_path / "data", **common)
        until(lambda: "cannot configure" in graph.log(strict), 60, "a strict node refuses")
        assert str(port) in graph.log(strict)
        graph.active(surface)
        assert "no live page" in graph.log(surface)
        other.close()
        until(lambda: f"page: http://127.0.0.1:{port}/" in graph.log(surface), 15, "the page")

        def cleared():
            alarms = running_graph.sections(f"http://127.0.0.1:{port}/").get("alarms")
            return alarms and not any(a["active"] for a in alarms["rows"] if a["id"] == "page.port")

        # The page answers before the well's state is first known, and before the alarm has ended.
        until(cleared, 15, "the end of the alarm")
        assert graph.end(surface)[0] == 0


@pytest.mark.fault_case(85)
def test_parameters_are_described_and_changed_all_or_nothing(played):
    reported = played["reported"]
    assert reported["good set"][0]
    assert not reported["bad set"][0]
    assert not reported["fixed set"][0]
    assert reported["description"][0].startswith("Averaging time of a survey")
    assert "[s] (1 to 600)" in reported["description"][0]
    assert reported["description"][1] == 600.0
    assert reported["state"] == "active"


def test_a_subscription_with_the_default_profile_receives_the_streams(played):
    expected = ["attitude", "gravity", "imu/data_raw", "imu/mag"]
    assert played["reported"]["with the default profile"] == expected


@pytest.mark.fault_case(86)
def test_services_say_why_not(played):
    reported = played["reported"]
    assert "operator_name" in reported["nameless"]
    assert reported["rejected"]
    assert reported["accepted"]
    assert "bit_depth" in reported["nan depth"]
    assert "nT would be" in reported["bad field"]
    assert "fault_injection" in reported["fault"]
    assert Path(reported["export"]).read_text().count("\n") > 5


def test_surveys_agree_with_the_simulated_truth(played):
    surveys = messages_of(played["bag"], "/w1/survey")
    truth = samples_of(played["bag"], "/w1/truth")
    assert len(surveys) == 2
    for survey in surveys:
        at = survey.header.stamp.sec * 10**9 + survey.header.stamp.nanosec
        true = truth[np.argmin(np.abs(truth["stamp_ns"] - at))]
        assert survey.north == 2
        assert math.degrees(abs(survey.inclination - true["inclination"])) < 0.15
        assert math.degrees(abs(wrap_pi(survey.azimuth - true["azimuth"]))) < 1.5
        raw = next(one for one in survey.azimuths if one.method == "raw")
        assert math.degrees(abs(wrap_pi(raw.azimuth - true["azimuth"]))) > 1.0
        assert 2.0e-6 < survey.axial_interference < 3.0e-6


def _modbus_status(address):
    """Register 2 of a Modbus server."""
    host, port = address.rsplit(":", 1)
    with socket.create_connection((host, int(port)), 10.0) as connection:
        connection.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, 2, 1))
        return struct.unpack(">H", connection.recv(64)[9:11])[0]


def test_the_state_of_the_rig_interfaces_lies_in_the_folder_while_the_graph_lives(played):
    assert played["rig"].alive(played["asked"])
    (modbus,) = played["rig"].interfaces
    assert (modbus.name, modbus.state) == ("modbus", "listening")
    assert not played["rig file"].exists()


def test_a_rig_is_told_that_the_tool_is_simulated_however_the_nodes_were_started(played):
    assert played["modbus status"] >> StatusBit.SIMULATED & 1


def test_the_frame_of_every_header_resolves_in_tf(played):
    parents, named = {}, {}
    with Bag(played["bag"]) as bag:
        for _, topic, _, data in bag.messages(list(bag.topics)):
            message = bag.decode(topic, data)
            for transform in getattr(message, "transforms", ()):
                parents[transform.child_frame_id] = transform.header.frame_id
            frame = getattr(getattr(message, "header", None), "frame_id", "")
            if frame:
                named.setdefault(frame, topic)
    # The controller's frame of commands has no axes; no command was given here.
    assert {"w1/sonde_link", "w1/rig_floor", "w1/local_enu", "w1/wellhead"} <= set(named)
    for frame, topic in named.items():
        root = frame
        while root in parents:
            root = parents[root]
        assert root == "w1/local_enu", f"{topic} is in {frame}"
    assert parents["w1/bit"] == "w1/sonde_link"


def test_the_recording_opens_in_the_libraries_with_every_message(played):
    with AnyReader([played["bag"]]) as reader:
        counts = {}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            counts[connection.topic] = counts.get(connection.topic, 0) + 1
        assert counts == {c.topic: c.msgcount for c in reader.connections if c.msgcount}
    (file,) = played["bag"].glob("*.mcap")
    with file.open("rb") as stream:
        read = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in read.iter_messages()) == sum(counts.values())
    assert counts["/w1/imu/data_raw"] >= 3300
    assert counts["/w1/attitude"] > 3000
    assert counts["/w1/gravity"] > 3000
    assert counts["/w1/survey/accepted"] >= 2
    assert "/diagnostics" in counts


def test_the_recording_carries_versions_and_the_parameters_of_every_node_but_no_secret(played):
    with Bag(played["bag"]) as bag:
        tables = bag.metadata()
    assert {"mwd", "parameters/surface", "parameters/estimator", "parameters/sonde"} <= set(tables)
    assert tables["parameters/estimator"]["place.lat_deg"] == "38.3"
    assert tables["parameters/surface"]["foxglove.enabled"] == "True"
    # A change at run time is in the recording, too.
    assert tables["parameters/surface"]["well.rig"] == "Rig 7"
    assert not any(TOKEN in value for table in tables.values() for value in table.values())


def test_the_surveys_and_their_report_are_enclosed_when_it_ends(played):
    (file,) = played["bag"].glob("*.mcap")
    with file.open("rb") as stream:
        enclosed = {a.name: a for a in make_reader(stream).iter_attachments()}
    assert {"surveys_definitive.csv", "surveys_raw.csv", "survey_report.html"} <= set(enclosed)
    assert enclosed["survey_report.html"].data.startswith(b"<!DOCTYPE html>")


def test_a_foxglove_viewer_gets_the_very_bytes_that_are_recorded(played):
    with Bag(played["bag"]) as bag:
        recorded = {data for _, _, _, data in bag.messages(["/w1/imu/data_raw"])}
    assert len(played["viewed"]) >= 200
    assert all(data in recorded for _, data in played["viewed"])


def test_processing_the_recording_gives_the_bits_that_were_published_live(played, tmp_path):
    live = samples_of(played["bag"], "/w1/attitude")
    pipeline = Pipeline(changed(EstimatorSettings(), PLACE))
    pushes = {
        "/w1/imu/mag": pipeline.push_mag,
        "/w1/gyro/data_raw": pipeline.push_precision,
        "/w1/imu/temperature": pipeline.push_temperature,
        "/w1/imu/data_raw": pipeline.push_imu,
    }
    again = []
    with Bag(played["bag"]) as bag:
        for block in bag.blocks(list(pushes)):
            for topic, push in pushes.items():
                if topic in block:
                    samples = block[topic][1]
                    # On a busy machine the estimator may be found a moment after the recorder.
                    output = push(samples[samples["stamp_ns"] >= live["stamp_ns"][0]])
                    again += [output.attitude] if output is not None else []
    processed = np.concatenate(again)
    assert len(live) > 3000
    assert len(processed) == len(live)
    assert processed.tobytes() == live.tobytes()


def test_processing_the_recording_without_options_gives_the_survey_list_that_was_kept_live(played, tmp_path):
    done = invoke(app, "process", played["bag"], "-o", tmp_path / "out")
    live, processed = surveys_of(played["bag"].parents[1])[0], surveys_of(tmp_path / "out")[0]
    assert [r.survey.sequence for r in processed.records] == [r.survey.sequence for r in live.records]
    for ours, theirs in zip(processed.records, live.records, strict=True):
        assert ours == theirs
    # The surface was not told where the well is; the recording has it from the estimator.
    place = {"latitude_deg": PLACE["place.lat_deg"], "longitude_deg": PLACE["place.lon_deg"]}
    assert processed.well == dataclasses.replace(live.well, **place)
    assert processed.legs == live.legs
    assert f"{len(live.records)} of {len(live.records)} surveys equal" in done.stdout
