# SPDX-License-Identifier: Apache-2.0
"""What the estimator node does by itself; its topics and services are tested on the graph."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from mwd_msgs.msg import OperatorEvent
from mwd_msgs.srv import SetReferenceField
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.nodes import diagnostics
from mwd_estimation.nodes.estimator import EstimatorNode, SampleCounts
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.settings.place import Place
from mwd_sensors.core import wire
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.core.mount import resolve

FIELD = Reference(5e-5, 1.2, 0.05, 0.0, 9.81, "measured on the pad")


def changed(**blocks):
    """A node's parts after its settings were changed, with what it answered meanwhile."""
    settings = EstimatorSettings()
    pipeline = Pipeline(settings)
    pipeline.set_reference(FIELD)
    pipeline.continue_numbering(7)
    answers = []
    node = SimpleNamespace(
        _pipeline=pipeline,
        _actions=SimpleNamespace(abort=answers.append),
        _respond=lambda success, message, _sequence: answers.append((success, message)),
        _times_set_back=3,
        _inputs=SimpleNamespace(mount=resolve, noise={}),
    )
    EstimatorNode.on_settings_changed(node, dataclasses.replace(settings, **blocks))
    return node, answers


@pytest.fixture
def node():
    """An estimator in a context of its own."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    made = EstimatorNode(context=context)
    try:
        yield made
    finally:
        made.destroy_node()
        rclpy.shutdown(context=context)


def test_a_node_that_was_never_configured_shuts_down_and_ends_its_process(node):
    assert node.trigger_shutdown() == TransitionCallbackReturn.SUCCESS
    assert node.stop_requested.done()


# Values that no parameter takes, whatever its type: of another type, no number, beyond any range, or no text.
NEVER = (float("inf"), -1e300, 1e300, -(2**62), [b"a"], [float("nan")] * 9, "a\0b", "\x1b[2J", "x" * 100_000)


@pytest.mark.fault_case(85)
@pytest.mark.parametrize("transitions", [(), ("configure",), ("configure", "activate")])
def test_no_parameter_takes_what_it_cannot_be_and_each_keeps_its_value(node, transitions):
    for name in transitions:
        assert getattr(node, f"trigger_{name}")() == TransitionCallbackReturn.SUCCESS
    names = [name for name in node._parameters if name not in ("use_sim_time", "start_type_description_service")]
    before = {name: repr(node.get_parameter(name).value) for name in names}
    settings = node.settings
    assert len(names) > 50
    for name in names:
        for value in NEVER:
            # A good one beside the bad one is not taken either.
            both = [Parameter("survey.duration_s", value=17.0), Parameter(name, value=value)]
            result = node.set_parameters_atomically(both if name != "survey.duration_s" else both[1:])
            assert not result.successful, (name, value)
            assert 10 < len(result.reason) < 1500, (name, value)
    assert {name: repr(node.get_parameter(name).value) for name in names} == before
    assert node.settings == settings


@pytest.mark.fault_case(85)
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("place.date", "2026-02-30"),
        ("place.date", "x"),
        ("frame_prefix", "other/"),
        ("survey.duration_s", 12),
        # The publishers of the transmission are made when the node is configured.
        ("transmit.tool_file", "other.yaml"),
        ("transmit.flow_hold_s", 7.0),
    ],
)
def test_a_day_that_does_not_exist_and_what_is_fixed_at_the_start_are_refused(node, name, value):
    before = node.get_parameter(name).value
    assert not node.set_parameters_atomically([Parameter(name, value=value)]).successful
    assert node.get_parameter(name).value == before


def test_a_change_of_settings_answers_a_survey_that_was_asked_for():
    _, answers = changed()
    assert [one[0] for one in answers if isinstance(one, tuple)] == [False]


@pytest.mark.parametrize(("silent", "waits_for"), [(True, "gyro"), (True, None), (False, "gyro")])
def test_a_survey_that_waits_goes_out_when_the_samples_stop(silent, waits_for):
    answers, published = [], []
    node = SimpleNamespace(
        _inputs=SimpleNamespace(silent=lambda topic: silent and topic == "imu/data_raw"),
        _pipeline=SimpleNamespace(still=SimpleNamespace(waits_for=waits_for)),
        _respond=lambda success, message, _sequence: answers.append((success, message)),
        _publish_pending_survey=lambda: published.append(True),
    )
    EstimatorNode._end_silent_survey(node)
    assert [success for success, _ in answers] == [False] * silent
    assert bool(published) == (silent and bool(waits_for))


def test_a_field_given_by_service_outlives_a_change_of_settings_but_not_of_the_place():
    settings = EstimatorSettings()
    kept, _ = changed(survey=dataclasses.replace(settings.survey, duration_s=12.0))
    assert kept._pipeline.given_reference == FIELD
    assert kept._pipeline.sequence == 7
    moved, _ = changed(place=dataclasses.replace(settings.place, lat_deg=60.0, lon_deg=2.0))
    assert moved._pipeline.given_reference is None


@pytest.mark.fault_case(36)
@pytest.mark.parametrize("date", ["2026-13-01", "1066-01-01", "2031-01-01"])
def test_a_day_that_the_field_model_does_not_know_is_refused_before_it_is_accepted(date):
    place = Place(field="model", lat_deg=60.0, lon_deg=2.0, date=date)
    with pytest.raises(ValueError, match=date[:4]):
        EstimatorNode.check_settings(SimpleNamespace(), EstimatorSettings(place=place))


@pytest.mark.fault_case(36)
def test_a_clock_outside_the_field_model_costs_the_reference_not_the_attitude():
    pipeline = Pipeline(EstimatorSettings(place=Place(field="model", lat_deg=60.0, lon_deg=2.0)))
    imu = wire.IMU.empty(400)
    imu["stamp_ns"] = np.arange(1, 401) * 10_000_000
    imu["linear_acceleration"] = (-7.0, 0.0, 7.0)
    output = pipeline.push_imu(imu)
    assert np.isfinite(output.attitude["inclination"]).all()
    shown = diagnostics.reference_diagnostic(pipeline.reference)
    assert "outside wmm2025" in shown.message
    assert "place.date" in shown.remedy


def test_a_request_has_the_time_of_the_samples_after_a_lone_stamp_and_after_the_clock_was_set_back():
    told = []
    node = SimpleNamespace(
        _pipeline=Pipeline(EstimatorSettings()),
        _inputs=SimpleNamespace(mount_key=(), take=lambda topic: taken.get(topic, wire.SONDE_TOPICS[topic].empty(0))),
        _mount_key=(),
        _gate=SimpleNamespace(passed=dict),
        _used=SampleCounts(),
        _logs=SimpleNamespace(push_temperature=lambda _: None, take=lambda *_: None),
        _publish=lambda *_: None,
        _frame="",
        _operator_events=SimpleNamespace(publish=lambda event: told.append(stamp_of(event.header.stamp))),
    )
    begin = 1_700_000_000_000_000_000
    steps = np.arange(1, 51) * 10_000_000
    lone = np.where(np.arange(50) == 49, 10**15, steps)
    expected = []
    for stamps in (begin + steps, begin + 500_000_000 + lone, begin + 1_000_000_000 + steps, begin - 10**14 + steps):
        imu = wire.IMU.empty(50)
        imu["stamp_ns"], imu["linear_acceleration"][:, 0] = stamps, -9.81
        taken = {"imu/data_raw": imu}
        EstimatorNode._estimate_block(node)
        EstimatorNode._tell(node, OperatorEvent.TAKE_SURVEY)
        expected.append(int(stamps[-1]))
    expected[1] -= int(lone[-1]) - int(lone[-2])
    assert told == expected


@pytest.mark.fault_case(86)
@pytest.mark.parametrize(
    ("gravity", "used"), [(9.79, 9.79), (np.nan, None), (0.0, None), (-9.81, ...), (-1e-300, ...), (98.1, ...)]
)
def test_a_gravity_that_a_service_gives_is_used_kept_or_refused_and_never_ignored(gravity, used):
    pipeline = Pipeline(EstimatorSettings())
    log = SimpleNamespace(info=lambda _: None)
    node = SimpleNamespace(_pipeline=pipeline, get_logger=lambda: log)
    request = SetReferenceField.Request(total=5e-5, dip=1.2, gravity=gravity, source="pad")
    response = EstimatorNode._used_reference(node, request, SetReferenceField.Response())
    assert response.success == (used is not ...)
    if used is ...:
        assert "gravity" in response.message
        assert pipeline.given_reference is None
    else:
        assert pipeline.given_reference.gravity == used
