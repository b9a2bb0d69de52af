# SPDX-License-Identifier: Apache-2.0
"""
Find the alarms that are evaluated. A missing alarm means nothing while its cause was not looked for.

A kind of alarm counts as evaluated once something came that would show its cause. A recording without diagnostics, or
a rig without data, leaves its kind in the list of what is not evaluated.
"""

from __future__ import annotations

from collections.abc import Collection

# What is judged, in words, and the topics of which one must have come.
_DIRECT = (
    ("samples of the sonde", ("imu/data_raw", "imu/mag", "imu/temperature")),
    ("attitude and surveys", ("attitude",)),
)
_OVER_LINK = (("telemetry link", ("link/quality",)),)
_ALWAYS = (
    ("rig data and depth", ("rig/state",)),
    ("sensors and nodes", ("/diagnostics",)),
    ("heartbeats", ("heartbeat",)),
)
# Rows of supervision that read the machine that records.
_MACHINE = {"disk.low", "queue.recorder"}


def not_evaluated(heard: Collection[str], judged: Collection[str], *, over_link: bool) -> tuple[str, ...]:
    """
    Return the kinds of alarms that could not be judged, in words.

    heard: topics of which a message has come. judged: rows of the table of supervision that had a reading.
    """
    kinds = (*(_OVER_LINK if over_link else _DIRECT), *_ALWAYS)
    missing = [words for words, topics in kinds if not any(topic in heard for topic in topics)]
    if not set(judged) >= _MACHINE:
        missing.append("recording and disk")
    return tuple(missing)
