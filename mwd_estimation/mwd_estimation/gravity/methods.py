# SPDX-License-Identifier: Apache-2.0
"""
Gravity methods by name: each published method can be selected, and all return the same `Track`.

A method has four parts with the same meaning everywhere: `Params` (settings with defaults), `initial(params)` (returns
the state before the first sample, an object with a method `copy`), `run(params, state, stamp_ns, gyro_t, accel_t)`
(processes a block of any length and changes the state in place), and a sentence that describes the method.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

from mwd_estimation.core.track import Track
from mwd_estimation.gravity import accelerometer_only, fuzzy_mahony, ligorio_kalman
from mwd_estimation.gravity.bounded import filter as bounded

__all__ = ["DEFAULT", "METHODS", "Method", "Track", "method"]

DEFAULT = "bounded"


@dataclasses.dataclass(frozen=True)
class Method:
    """One gravity method; the module docstring explains the members."""

    name: str  #: name in the settings
    doc: str  #: sentence that describes the method
    Params: Callable[..., Any]
    initial: Callable[[Any], Any]
    run: Callable[..., Track]
    #: Whether `run` accepts clip flags (`core.clip_flags`) and magnetic samples as its last arguments.
    uses_field: bool = False


_MAHONY = functools.partial(fuzzy_mahony.MahonyParams, fuzzy=False)
_ALL = (
    Method(
        "bounded",
        "velocity-bounded error-state Kalman filter",
        bounded.BoundedParams,
        bounded.initial,
        bounded.run,
        uses_field=True,
    ),
    Method(
        "s3",
        "rotation-vector recursion, PI correction, fuzzy gain (S3)",
        fuzzy_mahony.MahonyParams,
        fuzzy_mahony.initial,
        fuzzy_mahony.run,
    ),
    Method(
        "mahony",
        "rotation-vector recursion and PI correction with fixed gains",
        _MAHONY,
        fuzzy_mahony.initial,
        fuzzy_mahony.run,
    ),
    Method(
        "kalman",
        "linear Kalman extraction with a Gauss-Markov acceleration (Ligorio type)",
        ligorio_kalman.LigorioParams,
        ligorio_kalman.initial,
        ligorio_kalman.run,
    ),
    Method(
        "raw",
        "direction of the accelerometer alone",
        accelerometer_only.AccelerometerParams,
        accelerometer_only.initial,
        accelerometer_only.run,
    ),
)
METHODS: dict[str, Method] = {one.name: one for one in _ALL}


def method(name: str) -> Method:
    """
    Return the method with this name.

    Raises
    ------
    ValueError
        If there is no method of this name; the message lists the names.
    """
    if name not in METHODS:
        raise ValueError(f"method: no gravity method {name!r}; known: {', '.join(METHODS)}")
    return METHODS[name]
