# SPDX-License-Identifier: Apache-2.0
"""Trace of the bounded filter for the smoother: a record for each update of the covariance."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.gravity.bounded.state import STEADY, Sums
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.records import dtype_of


class Update:
    """One update of the covariance."""

    sample: int
    """Sample of the block at which it was made."""
    epoch: int
    """Number of the start it belongs to; -1 while the x gyro clips."""
    sums: Sums
    correction: Annotated[Array, STEADY]
    """Errors put into the nominal values."""
    before: Annotated[Array, STEADY, STEADY]
    """Covariance before the measurement."""
    after: Annotated[Array, STEADY, STEADY]
    """Covariance after it."""
    factors: Annotated[Array, 2]
    """Of the covariance, along the hole and across it."""
    floors: Annotated[Array, 2]
    """Variances to be added, rad^2."""


UPDATE = dtype_of(Update)


class Log(NamedTuple):
    """Trace of a block."""

    entries: NDArray[np.int64]  #: int64, shape (1,); updates written
    updates: Any  #: structured ndarray of `Update`, shape (m,); room for them; none: no trace is kept
    north_t: Array  #: shape (n, 3); first level axis in tool axes, sample by sample

    @classmethod
    def room(cls, samples: int) -> Log:
        """Room for a block of so many samples, each of which may end in an update."""
        return cls(np.zeros(1, dtype=np.int64), np.zeros(samples, dtype=UPDATE), np.zeros((samples, 3)))
