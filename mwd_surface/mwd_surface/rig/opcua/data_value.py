# SPDX-License-Identifier: Apache-2.0
"""Conversion of a variable's value to an OPC UA DataValue."""

from __future__ import annotations

import datetime as dt
from typing import Any

from mwd_surface.rig.opcua.address_space import VariableValue

EPOCH = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)


def moment(stamp_ns: int) -> dt.datetime:
    """Return a stamp, ns since the epoch, as a UTC datetime with microseconds."""
    return EPOCH + dt.timedelta(microseconds=stamp_ns // 1000)


def data_value(ua: Any, reading: VariableValue, kind: str) -> Any:
    """
    Return a DataValue with the time of the measurement as source timestamp and the present time as server timestamp.

    ua: `asyncua.ua`; kind: name of the variable's `VariantType`. A reading without a stamp has no source timestamp.
    """
    return ua.DataValue(
        ua.Variant(reading.value, getattr(ua.VariantType, kind)),
        StatusCode=ua.StatusCode(reading.status),
        SourceTimestamp=moment(reading.stamp_ns) if reading.stamp_ns else None,
        ServerTimestamp=dt.datetime.now(dt.UTC),
    )
