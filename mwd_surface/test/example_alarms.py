# SPDX-License-Identifier: Apache-2.0
"""The alarm log of a well without a node."""

from mwd_surface.live.alarms import AlarmLog


def active(log: AlarmLog):
    """Return the active alarms by their id."""
    return {alarm.id: alarm for alarm in log.alarms() if alarm.active}
