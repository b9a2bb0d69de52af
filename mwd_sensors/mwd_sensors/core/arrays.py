# SPDX-License-Identifier: Apache-2.0
"""The array types of all packages, so that a signature says what an array holds, and how samples are joined."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Measurements, states, covariances; the docstring beside it names shape and unit."""

Vector = Array | tuple[float, float, float]
"""
Three components: an array of shape (3,), or the numbers themselves.

Kernels that run once a sample pass numbers: numba counts the references of an array at each call.
"""

Stamps = NDArray[np.int64]
"""Times of measurement, ns since 1970."""

Indices = NDArray[np.int64]
"""Places in another array, or counts."""

Bytes = NDArray[np.uint8]
"""Raw bytes of messages or of a file."""

Samples = NDArray[np.void]
"""Structured array of samples: one named record for each, as laid out in `mwd_sensors.core.wire`."""


def joined(parts: Sequence[Samples]) -> Samples:
    """Join samples of one layout, at least one part."""
    # As bare bytes: joining records looks at each of their fields.
    kind = parts[0].dtype
    return np.concatenate([part.view(f"V{kind.itemsize}") for part in parts]).view(kind)
