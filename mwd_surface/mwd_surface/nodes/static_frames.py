# SPDX-License-Identifier: Apache-2.0
"""The fixed transforms of one well: wellhead and rig floor at the origin of the path, the bit ahead of the sonde."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from mwd_sensors.core import frames, wire
from mwd_sensors.ros.qos import LATCHED
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.live.source_selection import MODBUS, OPCUA, WITS
from mwd_surface.ros.context import SurfaceContext

_NORTH_EAST_DOWN = [float(v) for v in frames.orientation_et(np.eye(3))]


class StaticFrames:
    """Publisher of `/tf_static`; it publishes again when the tool's frame or its distance to the bit changes."""

    def __init__(self, context: SurfaceContext) -> None:
        self._context = context
        self._published: tuple[str, float] | None = None

    def open(self) -> None:
        """Open the topic."""
        self._publisher = self._context.node.add_publisher(TFMessage, "/tf_static", LATCHED)

    def publish(self, tool_frame: str, sensor_to_bit: float) -> None:
        """
        Publish the transforms if they changed.

        tool_frame : frame of the tool's messages, empty while unknown. sensor_to_bit : distance along the tool, m.
        """
        if self._published == (tool_frame, sensor_to_bit):
            return
        node = self._context.node
        local = node.frame(wire.LOCAL_FRAME)
        wellhead = self._transform(local, node.frame(wire.WELLHEAD_FRAME))
        turned = wellhead.transform.rotation
        turned.x, turned.y, turned.z, turned.w = _NORTH_EAST_DOWN
        floor = node.frame(wire.RIG_FRAME)
        # Rig data received through an interface of this project have the interface's name as frame; it is the rig
        # floor.
        ours = [self._transform(floor, node.frame(name)) for name in (OPCUA, WITS, MODBUS)]
        transforms = [wellhead, self._transform(local, floor), *ours]
        if tool_frame:
            bit = self._transform(tool_frame, node.frame(wire.BIT_FRAME))
            bit.transform.translation.x = sensor_to_bit
            transforms.append(bit)
        self._publisher.publish(TFMessage(transforms=transforms))
        self._published = tool_frame, sensor_to_bit

    def _transform(self, parent: str, child: str) -> TransformStamped:
        transform = TransformStamped(child_frame_id=child)
        transform.header.frame_id = parent
        transform.header.stamp = stamp(self._context.now_ns())
        return transform
