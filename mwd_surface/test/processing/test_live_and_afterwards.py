# SPDX-License-Identifier: Apache-2.0
"""One result, live and afterwards: the list of a graph and that of its recording, whatever failed or was asked for."""

import dataclasses
import math
import os
import re

import numpy as np
import pytest
from live_graph import ACCEPT, REJECT, RESET, ROTARY, TAKE, LiveGraph

from mwd_estimation.survey.survey import Verdict
from mwd_sensors.core import wire
from mwd_sensors.simulator.scenario import read
from mwd_surface.bags.bag_reader import Bag, BagError
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.processing import process
from mwd_surface.processing.bag_input import InputSettings, find_topics, guesses, namespace_of
from mwd_surface.surveys.recorded_settings import recorded_settings
from project import ROOT, SCENARIOS

pytestmark = pytest.mark.slow(1.5)

SCHEDULE = [
    {"kind": "still", "seconds": 14.0, "pumps": False},
    {"kind": "drill", "seconds": 14.0, "rpm": 120.0, "rop_m_h": 60.0},
    {"kind": "still", "seconds": 14.0, "pumps": False},
]
# Each kind of failure once, of any sensor: most from the first sample on, some within or after the first survey. In the
# gate every sensor, samples that are missing, unusable, late and wrong, and a fault that begins later.
FAULTS = [
    ("accel", "off", "all", 0.0),
    ("gyro", "nan", "all", 0.0),
    ("mag", "delayed", "all", 0.0),
    ("precision_gyro", "off", "all", 0.0),
    ("accel", "stuck", "all", 9.0),
    ("mag", "flipped", "all", 25.0),
]
OTHER_FAULTS = [
    *(("accel", word, "all", 0.0) for word in ("slow", "in_g", "saturated", "garbage", "intermittent")),
    *(("gyro", word, "all", 0.0) for word in ("stuck", "in_deg_s", "wrong")),
    *(("mag", word, "all", 0.0) for word in ("flipped", "in_ut")),
    ("accel", "swapped", "xz", 0.0),
]


def story(faults=(), schedule=SCHEDULE, **changes):
    given = {"schedule": schedule, "faults": [dict(zip(KEYS, one, strict=True)) for one in faults], **changes}
    return read(SCENARIOS / "default.yaml", given)


KEYS = ("component", "fault", "axis", "start_s")


def processed(path, out, **given):
    with Bag(path) as bag:
        recorded = recorded_settings(bag)
        return process.process(bag, out, recorded.estimator, InputSettings(**given), recorded=recorded)


def both(folder, made, actions=(), *, seconds=math.inf, **options):
    """Lists live and afterwards, and the summary of what was processed."""
    live = LiveGraph(folder / "bag", made, **options)
    surveys = live.run(actions, seconds=seconds)
    return surveys, processed(folder / "bag", folder / "out"), live


@pytest.mark.parametrize(
    ("component", "word", "axis", "start_s"),
    [*FAULTS, *(pytest.param(*one, marks=pytest.mark.nightly) for one in OTHER_FAULTS)],
)
def test_the_verdicts_of_a_faulty_tool_are_the_same_live_and_afterwards(component, word, axis, start_s, tmp_path):
    live, summary, _ = both(tmp_path, story([(component, word, axis, start_s)]))
    assert summary.other_input == []
    assert summary.listed == live
    first = {one.uuid: one.station.verdict for one, _ in summary.surveys}
    assert first == {r.survey.uuid: Verdict(r.as_first_decided.verdict).word for r in summary.listed.records}


@pytest.mark.parametrize("mount", ["z-down", pytest.param("y-up", marks=pytest.mark.nightly), "x-up"])
def test_surveys_before_a_wrong_mount_was_named_are_withdrawn_live_as_afterwards(mount, tmp_path):
    live, summary, _ = both(tmp_path, story(), mount=mount)
    assert summary.listed == live
    first = live.records[0].survey
    assert (Verdict(first.verdict), first.withdrawn) == (Verdict.REJECT, True)
    assert not any(record.in_use for record in live.records)
    assert f"set tool.mount.imu to {mount}" in first.reasons[0]


@pytest.mark.parametrize("wrong", ["y-down", pytest.param("z-up", marks=pytest.mark.nightly), "x-up"])
def test_the_remedy_names_the_mount_of_the_unit_whatever_is_set(wrong, tmp_path):
    live = LiveGraph(tmp_path / "bag", story(), **{"tool.mount.imu": wrong}).run()
    assert "set tool.mount.imu to x-down" in live.records[0].survey.reasons[0]


def test_under_the_right_mount_both_surveys_are_accepted(tmp_path):
    live = LiveGraph(tmp_path / "bag", story(), **{"tool.mount.imu": "x-down"}).run()
    assert [Verdict(r.survey.verdict) for r in live.records] == [Verdict.ACCEPT, Verdict.ACCEPT]


LONG = [
    {"kind": "still", "seconds": 30.0, "pumps": False},
    {"kind": "drill", "seconds": 25.0, "rpm": 100.0, "rop_m_h": 60.0},
    {"kind": "still", "seconds": 25.0, "pumps": False},
    {"kind": "drill", "seconds": 10.0, "rpm": 100.0, "rop_m_h": 60.0},
    {"kind": "still", "seconds": 15.0, "pumps": False},
]
EVENTS = {
    "asked for before the first survey": [(0.5, lambda g: g.ask(TAKE, 4.0))],
    "several at a station": [(t, lambda g: g.ask(TAKE, 3.0)) for t in (13.0, 18.0, 23.0)],
    "asked for twice": [(13.0, lambda g: g.ask(TAKE, 5.0)), (13.4, lambda g: g.ask(TAKE, 3.0))],
    "rotary": [(35.0, lambda g: g.ask(ROTARY, 8.0)), (46.0, lambda g: g.judge(ACCEPT, 1, "Ann", depth=1011.0))],
    "rotary twice": [(35.0, lambda g: g.ask(ROTARY, 8.0)), (36.0, lambda g: g.ask(ROTARY, 5.0))],
    "restart": [(20.0, lambda g: g.ask(RESET)), (40.0, lambda g: g.ask(RESET))],
    "rejected, and a survey at its depth": [
        (56.0, lambda g: g.judge(REJECT, 1, "Ann")),
        (58.0, lambda g: g.ask(TAKE, 3.0)),
        (66.0, lambda g: g.judge(ACCEPT, 1, "Bob", depth=1010.0)),
    ],
    "decided again and again": [
        (56.0 + k, lambda g, k=k: g.judge((REJECT, ACCEPT)[k % 2], 1, "Ann")) for k in range(5)
    ],
    "refused": [
        (56.0, lambda g: g.judge(ACCEPT, 1, "")),
        (57.0, lambda g: g.judge(REJECT, 9, "Ann")),
        (58.0, lambda g: g.ask(TAKE, -3.0)),
        (59.0, lambda g: g.ask(ROTARY, math.nan)),
        (60.0, lambda g: g.judge(ACCEPT, 1, "Ann", depth=-7.0)),
    ],
    "after the last sample": [(1e6, lambda g: g.judge(REJECT, 1, "Ann")), (1e6, lambda g: g.judge(ACCEPT, 2, "Bob"))],
    "accepted before it is withdrawn": [(31.0, lambda g: g.judge(ACCEPT, 1, "Ann"))],
}


# Names of events that happen in one run.
TOGETHER = [
    (
        *("asked for before the first survey", "asked for twice", "accepted before it is withdrawn", "rotary twice"),
        *("rejected, and a survey at its depth", "decided again and again", "after the last sample"),
    ),
    ("several at a station", "rotary", "refused"),
    ("restart",),
]
# Under a wrong mount the surveys are withdrawn, which meets what people asked for.
MET = [("accepted before it is withdrawn",)]
OTHER_MET = [("restart",), ("several at a station",), ("rotary",), ("rejected, and a survey at its depth",)]


@pytest.mark.parametrize(
    ("names", "mount"),
    [
        *((names, "x-down") for names in TOGETHER),
        *((names, "z-down") for names in MET),
        *(pytest.param((name,), "x-down", marks=pytest.mark.nightly) for name in EVENTS),
        *(pytest.param(names, "z-down", marks=pytest.mark.nightly) for names in OTHER_MET),
    ],
)
def test_the_list_of_people_s_requests_comes_out_again(names, mount, tmp_path):
    actions = [action for name in names for action in EVENTS[name]]
    live, summary, graph = both(tmp_path, story(schedule=LONG), actions, mount=mount)
    assert summary.listed == live
    assert summary.live == f"{len(live.records)} of {len(live.records)} surveys equal those of the live list"
    assert not [text for text in summary.warnings if "not taken" in text]
    assert "refused" not in names or all(graph.answers[-5:])


# Requests of people within a run of any scenario: some are refused, where nothing stands still or was surveyed.
REQUESTS = [
    (20.0, lambda g: g.ask(TAKE, 4.0)),
    (45.0, lambda g: g.ask(ROTARY, 8.0)),
    (80.0, lambda g: g.judge(REJECT, 1, "Ann")),
    (90.0, lambda g: g.judge(ACCEPT, 1, "Bob", depth=1010.0)),
    (95.0, lambda g: g.judge(REJECT, 2, "Ann")),
]
# A lossy link with jumps in time, a drifting clock, a dual unit, stick-slip; `make sweep` plays all, and for longer.
SWEEP_S = float(os.environ.get("SWEEP_SECONDS", "0"))
PLAYED = ["faults", "telemetry_serial", "s1_lab", "stick_slip_hell"]
ALL = sorted([*SCENARIOS.glob("*.yaml"), *(ROOT / "tests/graph/scenarios").glob("*.yaml")])
# Times of the gate's runs, s: within `faults` time jumps and the link loses bursts.
LASTS_S = {"faults": 215.0}


@pytest.mark.slow(3)
@pytest.mark.parametrize("path", [one for one in ALL if SWEEP_S or one.stem in PLAYED], ids=lambda path: path.stem)
def test_a_scenario_with_requests_of_people_has_the_same_list_live_and_afterwards(path, tmp_path):
    live, summary, _ = both(tmp_path, read(path), REQUESTS, seconds=SWEEP_S or LASTS_S.get(path.stem, 100.0))
    assert summary.other_input == []
    assert summary.listed == live


def test_a_recorder_without_the_events_is_told_to_record_them_and_the_decisions_are_those_of_the_lists(tmp_path):
    actions = [(13.0, lambda g: g.ask(TAKE, 4.0)), (75.0, lambda g: g.judge(REJECT, 1, "Ann"))]
    skip = ("operator_events", "used_samples")
    live, summary, _ = both(tmp_path, story(schedule=LONG[:3]), actions, skip=skip)
    assert any("/w1/operator_events" in text for text in summary.warnings)
    assert summary.live.endswith("missing here: 1")
    judged = {r.survey.uuid: r.operator_name for r in live.records}
    same = [r for r in summary.listed.records if r.survey.uuid in judged]
    assert [r.operator_name for r in same] == [judged[r.survey.uuid] for r in same]
    assert "Ann" in judged.values()


def test_a_recording_that_lacks_samples_that_were_used_is_not_the_same_input(tmp_path):
    lost = {"imu/data_raw": 37, "imu/mag": 21}
    _, summary, _ = both(tmp_path, story(), lost=lost)
    assert len(summary.other_input) == len(lost)
    for text in summary.other_input:
        used, topic, recorded = re.search(
            r"used (\d+) samples of /w1/([^ ,]+), and the recording has (\d+)", text
        ).groups()
        assert int(used) - int(recorded) == lost.pop(topic)
        assert "the input differs from the live input" in text
    assert not lost


def test_requests_stand_at_their_sample_also_in_a_part_of_the_recording(tmp_path):
    live, whole, _ = both(tmp_path, story(schedule=LONG[:3]), EVENTS["several at a station"])
    part = processed(tmp_path / "bag", tmp_path / "part", start_s=30.0)
    asked = [one.uuid for one, _ in part.surveys if one.average.requested]
    assert asked == []
    kept = {one.uuid for one, _ in part.surveys} & {one.uuid for one, _ in whole.surveys}
    assert kept
    assert dataclasses.asdict(live) == dataclasses.asdict(whole.listed)


def plain_bag(path, namespaces, imu="imu/data_raw", results=("attitude",)):
    """A recording of one or more wells with the topics that their estimators publish, a few samples each."""
    samples = wire.IMU.empty(300)
    samples["linear_acceleration"] = [-9.7, 0.4, 1.0]
    with BagWriter(path) as bag:
        for k, space in enumerate(namespaces):
            samples["stamp_ns"] = 10**18 + k + np.arange(300) * 10_000_000
            for name in (imu if imu.startswith("/") else space + imu, f"{space}imu/data"):
                channel = bag.topic(name, wire.IMU.type_name)
                bag.write_rows(channel, wire.IMU.encode(samples, "sonde_link"), samples["stamp_ns"])
            for name in results:
                rows = wire.ATTITUDE.empty(300)
                rows["stamp_ns"] = samples["stamp_ns"]
                channel = bag.topic(space + name, wire.ATTITUDE.type_name)
                bag.write_rows(channel, wire.ATTITUDE.encode(rows, "sonde_link"), rows["stamp_ns"])
    return path


@pytest.mark.parametrize("space", ["/", "/w1/", "/pad/w1/"])
@pytest.mark.parametrize("imu", ["imu/data_raw", "/driver/imu", "/xsens/imu/data"])
def test_the_estimator_s_own_imu_is_no_question(space, imu, tmp_path):
    with Bag(plain_bag(tmp_path / "bag", [space], imu)) as bag:
        topics = find_topics(bag, InputSettings())
        assert topics.imu == (imu if imu.startswith("/") else space + imu)
        assert not [text for text in guesses(bag, topics, InputSettings()) if "imu/data;" in text or "not used" in text]
        assert namespace_of(bag, topics.imu) == space


def test_of_two_wells_in_one_recording_the_one_that_is_named_has_no_own_output_as_an_input(tmp_path):
    with Bag(plain_bag(tmp_path / "bag", ["/w1/", "/w2/"])) as bag:
        with pytest.raises(BagError, match="2 topics that end in 'imu/data_raw': /w1/imu/data_raw, /w2/imu/data_raw"):
            find_topics(bag, InputSettings())
        given = InputSettings(imu_topic="/w2/imu/data_raw")
        topics = find_topics(bag, given)
        assert (topics.imu, topics.precision) == ("/w2/imu/data_raw", None)
        assert guesses(bag, topics, given) == []


def test_a_filtered_imu_of_another_driver_may_be_the_imu(tmp_path):
    path = plain_bag(tmp_path / "bag", ["/w1/"], "/other/imu", results=())
    with Bag(path) as bag, pytest.raises(BagError, match="/other/imu, /w1/imu/data"):
        find_topics(bag, InputSettings())
