# SPDX-License-Identifier: Apache-2.0
"""A recording published again by a real node, received by a real subscriber on a middleware domain of its own."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import plotted_bag
import pytest
from other_definitions import other_definitions

from mwd_sensors.core import wire
from mwd_surface.bags.bag_metadata import qos_profile, qos_text
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.runs import launch_plan

rclpy = pytest.importorskip("rclpy", reason="ROS is not installed for this Python")

from mwd_msgs.msg import Survey  # noqa: E402
from mwd_msgs.srv import SeekReplay, SetReplayRate, StepReplay  # noqa: E402
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor  # noqa: E402
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy  # noqa: E402
from rclpy.serialization import deserialize_message  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import Imu, MagneticField  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from mwd_sensors.ros.qos import DEADLINE, LEASE, LONG_QUEUE  # noqa: E402
from mwd_sensors.ros.time_stamps import stamp  # noqa: E402
from mwd_surface.nodes import replay  # noqa: E402
from mwd_surface.ros.topics import TOPICS, message_class, profile_yaml  # noqa: E402

pytestmark = pytest.mark.slow(3)

START = 1_772_344_800_000_000_000
# Reliable, as a replay offers it: on a busy machine a listener may not lose what is compared one by one.
STREAM = QoSProfile(depth=5000, reliability=QoSReliabilityPolicy.RELIABLE)


def recording(path, seconds=4.0, rate=100):
    imu, mag = wire.IMU.empty(round(seconds * rate)), wire.MAG.empty(round(seconds * rate))
    imu["stamp_ns"] = mag["stamp_ns"] = START + np.arange(len(imu)) * (1_000_000_000 // rate)
    imu["linear_acceleration"][:, 0] = np.arange(len(imu))
    with BagWriter(path) as bag:
        stream = [qos_profile(reliability="best_effort", depth=200)]
        for name, layout, rows in (("imu/data_raw", wire.IMU, imu), ("imu/mag", wire.MAG, mag)):
            channel = bag.topic(f"/well_9/{name}", layout.type_name, stream)
            bag.write_rows(channel, layout.encode(rows, "sonde_link"), rows["stamp_ns"])
    return imu


class Listener:
    """Listens to a domain until stopped: bytes with their time of arrival, by topic."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = rclpy.create_node("listener", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.received = {}

    def listen(self, kind, topic):
        received = self.received[topic] = []
        self.node.create_subscription(
            kind, topic, lambda data: received.append((time.monotonic(), data)), STREAM, raw=True
        )

    def until(self, condition, seconds=90.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, {topic: len(received) for topic, received in self.received.items()}
            try:
                self.executor.spin_once(timeout_sec=0.05)
            except ExternalShutdownException:
                return

    def call(self, kind, name, **fields):
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request(**fields))
        self.until(future.done)
        return future.result()

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def graph(monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with launch_plan.own_domain({}) as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        listener = Listener(domain)
        processes = []

        def play(bag, *words):
            command = [sys.executable, "-m", "mwd_surface.cli", "replay", str(bag), "--wait", "60", *map(str, words)]
            processes.append(subprocess.Popen(command, env=os.environ, stderr=subprocess.PIPE, text=True))
            return processes[-1]

        yield listener, play
        for process in processes:
            process.kill()
            process.communicate()
        listener.close()


@pytest.mark.ros
def test_every_message_comes_in_order_at_the_pace_asked_for(graph, tmp_path):
    listener, play = graph
    imu = recording(tmp_path / "bag")
    for kind, topic in ((Imu, "/well_9/imu/data_raw"), (MagneticField, "/well_9/imu/mag"), (Clock, "/clock")):
        listener.listen(kind, topic)
    process = play(tmp_path / "bag", "--rate", 2)
    listener.until(lambda: process.poll() is not None)
    assert process.returncode == 0
    arrived = listener.received["/well_9/imu/data_raw"]
    samples = np.concatenate([wire.IMU.decode(data) for _, data in arrived])
    assert (samples == imu).all()
    assert len(listener.received["/well_9/imu/mag"]) == len(imu)
    # A second between messages that are 2 s apart in the recording; a busy machine delays some: the median counts.
    at = np.array([arrival for arrival, _ in arrived])
    assert np.median(at[200:] - at[:200]) == pytest.approx(1.0, rel=0.1)
    times = [deserialize_message(data, Clock).clock for _, data in listener.received["/clock"]]
    clock = [time.sec * 10**9 + time.nanosec for time in times]
    assert clock == sorted(clock)
    assert START <= clock[0] < clock[-1] <= START + 4_100_000_000
    assert len(clock) > 100


@pytest.mark.ros
def test_a_part_of_the_time_and_one_topic_can_be_chosen_and_begin_again_until_an_interrupt(graph, tmp_path):
    listener, play = graph
    recording(tmp_path / "bag")
    for kind, topic in ((Imu, "/well_9/imu/data_raw"), (MagneticField, "/well_9/imu/mag"), (Clock, "/clock")):
        listener.listen(kind, topic)
    part = ("--start", 1, "--end", 2, "--topic", "/well_9/imu/data_raw", "--no-clock", "--loop")
    process = play(tmp_path / "bag", "--rate", 4, *part)
    arrived = listener.received["/well_9/imu/data_raw"]
    listener.until(lambda: len(arrived) > 250)
    process.send_signal(signal.SIGINT)
    listener.until(lambda: process.poll() is not None)
    assert process.returncode == 0
    stamps = [int(wire.IMU.decode(data)["stamp_ns"][0]) for _, data in arrived]
    assert stamps[:200] == [START + k * 10_000_000 for k in range(100, 200)] * 2
    assert listener.received["/well_9/imu/mag"] == listener.received["/clock"] == []


@pytest.mark.ros
def test_a_topic_that_was_recorded_with_another_definition_of_its_type_is_not_published(graph, tmp_path):
    listener, play = graph
    imu, survey = wire.IMU.empty(100), "mwd_msgs/msg/Survey"
    imu["stamp_ns"] = START + np.arange(100) * 10_000_000
    with BagWriter(tmp_path / "bag", other_definitions(tmp_path / "old")) as bag:
        store = bag.definitions.typestore
        channels = [bag.topic(f"/{name}", kind) for name, kind in (("imu", wire.IMU.type_name), ("survey", survey))]
        bag.write_rows(channels[0], wire.IMU.encode(imu, "sonde_link"), imu["stamp_ns"])
        message = plotted_bag.arrays(plotted_bag.blank(store, survey))
        bag.write(channels[1], bytes(store.serialize_cdr(message, survey)), START + 500_000_000)
    listener.listen(Imu, "/imu")
    listener.listen(Survey, "/survey")
    process = play(tmp_path / "bag")
    listener.until(lambda: process.poll() is not None)
    assert len(listener.received["/imu"]) == 100
    assert listener.received["/survey"] == []
    assert (
        "/survey (mwd_msgs/msg/Survey): it was recorded with another definition of this type" in process.stderr.read()
    )


@pytest.mark.fault_case(46)
@pytest.mark.ros
def test_a_replay_stands_still_steps_seeks_and_changes_its_pace(graph, tmp_path):
    listener, play = graph
    imu = recording(tmp_path / "bag", seconds=60.0)
    for kind, topic in ((Imu, "/well_9/imu/data_raw"), (Clock, "/clock")):
        listener.listen(kind, topic)
    process = play(tmp_path / "bag", "--topic", "/well_9/imu/data_raw", "--rate", 0.5)
    arrived, clock = listener.received["/well_9/imu/data_raw"], listener.received["/clock"]

    def place(message):
        return int(wire.IMU.decode(message[1])["linear_acceleration"][0, 0])

    def places():
        return [place(message) for message in arrived]

    def time_of(stamp):
        return stamp.sec * 10**9 + stamp.nanosec - START

    listener.until(lambda: len(arrived) > 5)
    assert listener.call(Trigger, "/replay/pause").success
    stepped = listener.call(StepReplay, "/replay/step", messages=3)
    assert (stepped.success, stepped.published) == (True, 3)
    stood = time_of(stepped.time) // 10_000_000
    listener.until(lambda: places() == list(range(stood + 1)))

    sought = listener.call(SeekReplay, "/replay/seek", offset=20.0)
    assert (sought.success, time_of(sought.time)) == (True, 20 * 10**9)
    stepped = listener.call(StepReplay, "/replay/step", duration=0.5)
    assert (stepped.published, time_of(stepped.time)) == (51, 20_500_000_000)
    listener.until(lambda: places()[stood + 1 :] == list(range(2000, 2051)))

    # Backward, by log time, on the move: /clock goes back with the samples.
    assert listener.call(Trigger, "/replay/resume").success
    assert listener.call(SetReplayRate, "/replay/set_rate", rate=4.0).success
    back = stamp(START + 10**9)
    assert time_of(listener.call(SeekReplay, "/replay/seek", time=back).time) == 10**9
    # One message at a time: decoding all of them each time would take longer than they do.
    listener.until(lambda: place(arrived[-1]) == 300)
    onward = places()
    assert onward[onward.index(100, stood + 1) :] == list(range(100, onward[-1] + 1))
    given = [time_of(deserialize_message(data, Clock).clock) for _, data in clock]
    assert min(given[k + 1] - given[k] for k in range(len(given) - 1)) < -(10**10)

    assert "rate" in listener.call(SetReplayRate, "/replay/set_rate", rate=-1.0).message
    refused = listener.call(SeekReplay, "/replay/seek", offset=61.0)
    assert not refused.success
    assert "from 0 to 59.99 s" in refused.message
    assert not listener.call(SeekReplay, "/replay/seek", offset=float("nan")).success
    assert listener.call(SetReplayRate, "/replay/set_rate", rate=50.0).success
    listener.until(lambda: process.poll() is not None)
    assert process.returncode == 0
    listener.until(lambda: place(arrived[-1]) == len(imu) - 1)


FREEZING_SUBSCRIBER = """
import os, signal, sys
import rclpy
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu
signal.alarm(60)
def on_message(message):
    print(round(message.linear_acceleration.x), flush=True)
    if message.linear_acceleration.x == 0.0: os.kill(os.getpid(), signal.SIGSTOP)
rclpy.init()
node = rclpy.create_node("subscriber")
node.create_subscription(Imu, sys.argv[1], on_message, QoSProfile(depth=5000))
rclpy.spin(node)
"""


@pytest.mark.ros
def test_a_replay_that_ends_waits_for_a_subscriber_without_processor_time(graph, tmp_path):
    """The subscriber stops at its first message: more is unacknowledged than the depth of the recorded profile."""
    _, play = graph
    imu = recording(tmp_path / "bag", seconds=20.0)
    command = [sys.executable, "-P", "-c", FREEZING_SUBSCRIBER, "/well_9/imu/data_raw"]
    with subprocess.Popen(command, env=os.environ, stdout=subprocess.PIPE, text=True) as subscriber:
        try:
            process = play(tmp_path / "bag", "--topic", "/well_9/imu/data_raw", "--rate", 1000)
            while f"published {len(imu)} messages" not in (line := process.stderr.readline()):
                assert line, "the replay ended"
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(2.0)
            subscriber.send_signal(signal.SIGCONT)
            assert process.wait(30.0) == 0
            assert [int(subscriber.stdout.readline()) for _ in imu] == list(range(len(imu)))
        finally:
            subscriber.kill()


def test_a_recorded_profile_is_offered_again():
    latched = replay.profile(qos_text([qos_profile(durability="transient_local", depth=1)]))
    assert latched.depth == 10
    assert latched.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
    assert latched.reliability == QoSReliabilityPolicy.RELIABLE
    streamed = replay.profile(qos_text([qos_profile("best_effort")]))
    assert streamed.reliability == QoSReliabilityPolicy.RELIABLE
    assert streamed.deadline.nanoseconds == 0
    assert streamed.depth == LONG_QUEUE
    assert replay.profile("").reliability == replay.STREAM.reliability
    assert replay.profile("what: [").reliability == replay.STREAM.reliability


def test_a_watched_topic_is_recorded_and_replayed_with_its_deadline_and_lease():
    recorded = replay.profile(profile_yaml(TOPICS["attitude"][1]))
    for ours, theirs in (
        (recorded.deadline, DEADLINE),
        (recorded.liveliness_lease_duration, LEASE),
    ):
        assert ours.nanoseconds == theirs.nanoseconds
    assert replay.profile("- {depth: 3, deadline: {sec: 1}}").depth == LONG_QUEUE


def test_a_type_that_is_not_installed_has_no_class():
    assert message_class("sensor_msgs/msg/Imu") is Imu
    assert message_class("no_such_msgs/msg/Thing") is None
    assert message_class("sensor_msgs/msg/NoSuchThing") is None
    assert message_class("nonsense") is None
