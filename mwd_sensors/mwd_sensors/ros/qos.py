"""Quality-of-service profiles of the graph, each named once."""

from rclpy.duration import Duration
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSLivelinessPolicy, QoSProfile, QoSReliabilityPolicy

# Raw samples and estimates at sensor rate: the newest matters, nobody waits for a lost one.
STREAM = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=200,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
# Surveys, rig state, alarms: every one counts and a late joiner gets those that were.
EVENT = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
# Tables and references: the last one is the whole truth.
LATCHED = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
# Low-rate values for people and machines that must not miss one but need no history.
STATE = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)

# What a controller may steer by: as STREAM and STATE, and a promise. A reader that asks for this deadline and lease (or
# longer ones) is told by the middleware when values stop (a hung node) or the writer dies; one that asks for nothing
# reads as before.
DEADLINE = Duration(seconds=1)
LEASE = Duration(seconds=2)
WATCHED_STREAM = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=200,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
    deadline=DEADLINE,
    liveliness=QoSLivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=LEASE,
)
WATCHED_STATE = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
    deadline=DEADLINE,
    liveliness=QoSLivelinessPolicy.AUTOMATIC,
    liveliness_lease_duration=LEASE,
)


def deep(profile: QoSProfile) -> QoSProfile:
    """That profile for a reader whose messages wait: what arrives while it is busy must not push out what waits."""
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=5000,
        reliability=profile.reliability,
        durability=profile.durability,
    )
