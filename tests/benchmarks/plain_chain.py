# SPDX-License-Identifier: Apache-2.0
"""
The live chain as a first version would be, for `bench_live.py` to compare with: one process for each role.

    python tests/benchmarks/plain_chain.py source|estimator|recorder SCENARIO
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from mcap.writer import Writer
from mwd_msgs.msg import Attitude, Gravity, Truth
from rclpy.executors import ExternalShutdownException
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, MagneticField, Temperature

from mwd_estimation.nodes.estimator import oriented_imu
from mwd_estimation.nodes.warm_up import warm_up
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.settings import changed
from mwd_sensors.ros import qos
from mwd_sensors.simulator.scenario import read
from mwd_sensors.simulator.sonde import Sonde
from running_graph import PLACE

SENSORS = {
    "imu/temperature": Temperature,
    "gyro/data_raw": Imu,
    "imu/mag": MagneticField,
    "truth": Truth,
    "imu/data_raw": Imu,
}
ESTIMATES = {"attitude": Attitude, "gravity": Gravity, "imu/data": Imu}


def typed(layout: wire.Layout, kind: Any, sample: Any) -> Any:
    """A message object with the sample's fields."""
    message = kind()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(sample["stamp_ns"]), wire.NANOSECONDS)
    message.header.frame_id = wire.SONDE_FRAME
    for name, primitive, count in layout.fields:
        value = sample[name]
        field = getattr(message, name)
        if hasattr(field, "get_fields_and_field_types"):
            for part, number in zip(field.get_fields_and_field_types(), value, strict=True):
                setattr(field, part, float(number))
        elif count > 1:
            setattr(message, name, [float(number) for number in value])
        else:
            setattr(message, name, float(value) if primitive == "float64" else int(value))
    return message


def sample_of(layout: wire.Layout, message: Any) -> Samples:
    """One sample with the message's fields."""
    sample = layout.empty(1)
    sample["stamp_ns"] = message.header.stamp.sec * wire.NANOSECONDS + message.header.stamp.nanosec
    for name, _, count in layout.fields:
        field = getattr(message, name)
        if hasattr(field, "get_fields_and_field_types"):
            field = [getattr(field, part) for part in field.get_fields_and_field_types()]
        sample[name][0] = np.asarray(field) if count > 1 else field
    return sample


def source(node: Any, scenario: Path) -> None:
    """Publishes each sample by a timer."""
    out = {name: node.create_publisher(kind, name, qos.STREAM) for name, kind in SENSORS.items()}
    sonde = Sonde(read(scenario, {}), epoch_ns=time.time_ns())
    blocks = sonde.blocks(0.1)
    waiting: list[tuple[float, str, Any]] = []
    next(Sonde(read(scenario, {})).blocks(0.1))
    began = time.monotonic()

    def tick() -> None:
        elapsed = time.monotonic() - began
        while not waiting or waiting[-1][0] < elapsed:
            block = next(blocks)
            rows = [
                (float((sample["stamp_ns"] - sonde.epoch_ns) * 1e-9), name, sample)
                for name in SENSORS
                for sample in block[name]
            ]
            waiting.extend(sorted(rows, key=lambda row: row[0]))
        while waiting and waiting[0][0] <= elapsed:
            _, name, sample = waiting.pop(0)
            out[name].publish(typed(wire.SONDE_TOPICS[name], SENSORS[name], sample))

    node.create_timer(0.001, tick)


def estimator(node: Any, _scenario: Path) -> None:
    """Estimates in each callback."""
    settings = changed(EstimatorSettings(), PLACE)
    warm_up(settings)
    pipeline = Pipeline(settings)
    out = {name: node.create_publisher(kind, name, qos.STREAM) for name, kind in ESTIMATES.items()}

    def on_imu(message: Any) -> None:
        samples = sample_of(wire.IMU, message)
        found = pipeline.push_imu(samples)
        out["attitude"].publish(typed(wire.ATTITUDE, Attitude, found.attitude[0]))
        out["gravity"].publish(typed(wire.GRAVITY, Gravity, found.gravity[0]))
        out["imu/data"].publish(typed(wire.IMU, Imu, oriented_imu(samples, found.attitude)[0]))

    pushes = {
        "imu/mag": pipeline.push_mag,
        "gyro/data_raw": pipeline.push_precision,
        "imu/temperature": pipeline.push_temperature,
    }
    for name, push in pushes.items():
        layout = wire.SONDE_TOPICS[name]
        node.create_subscription(
            SENSORS[name], name, lambda m, p=push, w=layout: p(sample_of(w, m)), qos.buffered(qos.STREAM)
        )
    node.create_subscription(Imu, "imu/data_raw", on_imu, qos.buffered(qos.STREAM))


def recorder(node: Any, _scenario: Path) -> None:
    """Writes each message in its callback."""
    writer = Writer("plain.mcap")
    writer.start("ros2")
    for name, kind in (SENSORS | ESTIMATES).items():
        schema = writer.register_schema(f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}", "ros2msg", b"")
        channel = writer.register_channel(name, "cdr", schema)

        def keep(message: Any, channel: int = channel) -> None:
            now = time.time_ns()
            writer.add_message(channel, now, serialize_message(message), now)

        node.create_subscription(kind, name, keep, qos.buffered(qos.STREAM))


def main() -> None:
    """Run one role until it is killed."""
    role, scenario = sys.argv[1], Path(sys.argv[2])
    rclpy.init()
    node = rclpy.create_node(role, namespace="w1")
    {"source": source, "estimator": estimator, "recorder": recorder}[role](node, scenario)
    print("ready", flush=True)
    try:
        rclpy.spin(node)
    except (ExternalShutdownException, KeyboardInterrupt):
        return


if __name__ == "__main__":
    main()
