# SPDX-License-Identifier: Apache-2.0
"""Parameters of the other nodes in a recording: those in force now, also after a change or a restart of a node."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.task import Future

from mwd_surface.ros.parameter_tables import ParameterTables


class Others:
    """A node whose peers answer at once, unless they are silent."""

    def __init__(self):
        self.values, self.silent, self.asked, self.on_event = {"place.lat_deg": 60.0, "token": "x"}, False, 0, None

    def add_client(self, _kind, _name):
        def call_async(request):
            self.asked += 1
            done = Future()
            if not self.silent:
                values = [
                    Parameter("a", value=self.values[n]).get_parameter_value() for n in getattr(request, "names", ())
                ]
                done.set_result(SimpleNamespace(result=SimpleNamespace(names=list(self.values)), values=values))
            return done

        return SimpleNamespace(service_is_ready=lambda: True, call_async=call_async)

    def resolve_service_name(self, name):
        return f"/w1/{name}"

    def add_subscription(self, _kind, _topic, callback, _qos):
        self.on_event = callback


@pytest.fixture
def known():
    node = Others()
    tables = ParameterTables(node, ("estimator",))
    tables.open()
    tables.request()
    assert tables.take_new() == {"parameters/estimator": {"place.lat_deg": "60.0"}}
    return node, tables


def test_a_changed_parameter_of_another_node_is_asked_for_and_told_once(known):
    node, tables = known
    node.values["place.lat_deg"] = 58.0
    node.on_event(ParameterEvent(node="/w1/another"))
    tables.request()
    assert tables.take_new() == {}
    node.on_event(ParameterEvent(node="/w1/estimator"))
    for _ in range(3):
        tables.request()
    assert tables.take_new() == {"parameters/estimator": {"place.lat_deg": "58.0"}}
    assert tables.value("estimator", "place.lat_deg") == "58.0"
    node.on_event(ParameterEvent(node="/w1/estimator"))
    tables.request()
    assert tables.take_new() == {}, "nothing has changed"


def test_a_node_that_died_before_its_answer_is_asked_again_when_it_is_back(known):
    node, tables = known
    node.silent = True
    tables.refresh()
    tables.request()
    node.silent, node.values["place.lat_deg"] = False, 58.0
    tables.request()
    assert tables.take_new() == {}
    node.on_event(ParameterEvent(node="/w1/estimator"))
    tables.request()
    assert tables.take_new() == {"parameters/estimator": {"place.lat_deg": "58.0"}}
