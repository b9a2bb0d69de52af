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

from rclpy.duration import Duration
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSLivelinessPolicy, QoSProfile, QoSReliabilityPolicy

# A lost sample is not sent again, because only the newest one matters.
STREAM = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=200,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
STATE = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)
# A subscriber that joins late receives the earlier events, up to 100.
EVENT = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
LATCHED = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)

# For topics that a controller acts on. The middleware notifies a subscriber that requests this deadline and lease, or
# longer ones, when messages stop (a hung node) or the publisher dies. Other subscribers just receive the messages.
DEADLINE = Duration(seconds=1)
LEASE = Duration(seconds=2)
DEADLINE_STREAM = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=200,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
    deadline=DEADLINE,
    liveliness=QoSLivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=LEASE,
)
DEADLINE_STATE = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
    deadline=DEADLINE,
    liveliness=QoSLivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=LEASE,
)


# Depth of a queue that must not lose messages: one second of five topics at 1 kHz.
LONG_QUEUE = 5000


def offered(profile: QoSProfile) -> QoSProfile:
    """Return a copy of a profile, but reliable, so that best-effort and reliable subscriptions receive its messages."""
    return QoSProfile(
        history=profile.history,
        depth=profile.depth,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=profile.durability,
        deadline=profile.deadline,
        liveliness=profile.liveliness,
        liveliness_lease_duration=profile.liveliness_lease_duration,
    )


def buffered(profile: QoSProfile) -> QoSProfile:
    """Copy a profile with a long queue, no deadline and no lease, for messages read or published many at once."""
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=LONG_QUEUE,
        reliability=profile.reliability,
        durability=profile.durability,
    )
