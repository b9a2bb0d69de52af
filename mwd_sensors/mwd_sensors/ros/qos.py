# SPDX-License-Identifier: Apache-2.0
"""
Quality-of-service profiles of the graph.

====================  ===========  ================  ==========================================
profile               reliability  durability        used for
====================  ===========  ================  ==========================================
STREAM                best effort  volatile          samples and estimates at the sensor's rate
STATE                 reliable     volatile          values at a few hertz
EVENT                 reliable     transient local   surveys, rig state: the last 100
LATCHED               reliable     transient local   tables: the last message is the whole table
DEADLINE_STREAM       as STREAM, with deadline and liveliness lease
DEADLINE_STATE        as STATE, with deadline and liveliness lease
====================  ===========  ================  ==========================================

These are the profiles that a subscription requests. A publisher offers `offered(profile)`, which is always reliable and
therefore serves best-effort and reliable subscriptions alike (REP-2003).
"""

import copy
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy


def _profile(depth: int, *, reliable: bool = True, latched: bool = False, **policies: Any) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        **policies,
    )


# A lost sample is not sent again, because only the newest one matters.
STREAM = _profile(200, reliable=False)
STATE = _profile(10)
# A subscriber that joins late receives the earlier events, up to 100.
EVENT = _profile(100, latched=True)
LATCHED = _profile(1, latched=True)

# For topics that a controller acts on. The middleware notifies a subscriber that requests this deadline and lease, or
# longer ones, when messages stop (a hung node) or the publisher dies. Other subscribers just receive the messages.
DEADLINE = Duration(seconds=1)
LEASE = Duration(seconds=2)
_WATCHED = {"deadline": DEADLINE, "liveliness": LivelinessPolicy.AUTOMATIC, "liveliness_lease_duration": LEASE}
DEADLINE_STREAM = _profile(200, reliable=False, **_WATCHED)
DEADLINE_STATE = _profile(10, **_WATCHED)


# Depth of a queue that must not lose messages: one second of five topics at 1 kHz.
LONG_QUEUE = 5000


def offered(profile: QoSProfile) -> QoSProfile:
    """Return a copy of a profile, but reliable, so that best-effort and reliable subscriptions receive its messages."""
    reliable = copy.copy(profile)
    reliable.reliability = ReliabilityPolicy.RELIABLE
    return reliable


def buffered(profile: QoSProfile) -> QoSProfile:
    """Copy a profile with a long queue, no deadline and no lease, for messages read or published many at once."""
    return _profile(
        LONG_QUEUE,
        reliable=profile.reliability == ReliabilityPolicy.RELIABLE,
        latched=profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
    )
