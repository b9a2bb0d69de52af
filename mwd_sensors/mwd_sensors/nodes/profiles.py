"""Quality-of-service profiles of the graph, each named once."""

from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

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


def deep(profile: QoSProfile) -> QoSProfile:
    """That profile for a reader whose messages wait: what arrives while it is busy must not push out what waits."""
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=5000,
        reliability=profile.reliability,
        durability=profile.durability,
    )
