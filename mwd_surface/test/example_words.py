# SPDX-License-Identifier: Apache-2.0
"""Words as a receiver gives them."""

from mwd_sensors.telemetry.words import COMMON
from mwd_surface.receiver.words import BELIEVED, ReceivedWord


def received(name, value=None, *, raw=None, table=COMMON, bits=0, start_s=0.0, **fields):
    """Return a believed word of a survey, five seconds long, by its value or its code."""
    word = table[name]
    raw = word.code(value, bits) if raw is None else raw
    usual = {
        "start_s": start_s,
        "end_s": start_s + 5.0,
        "frame": 0,
        "index": 0,
        "kind": "survey",
        "name": name,
        "unit": word.unit,
        "raw": raw,
        "value": word.value(raw, bits),
        "confidence": 0.999,
        "sigma": word.sigma_of(bits),
        "status": BELIEVED,
        "alternatives": (),
    }
    return ReceivedWord(**{**usual, **fields})
