# SPDX-License-Identifier: Apache-2.0
"""Array types for the signatures of all packages, and a function that joins arrays of samples."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Measurements, states or covariances; the docstring of each argument gives its shape and unit."""

Vector = Array | tuple[float, float, float]
"""
Three components: an array of shape (3,), or a tuple of three numbers.

Kernels that run once per sample pass tuples: numba counts the references to an array at each call, which takes time.
"""

Stamps = NDArray[np.int64]
"""Times of measurement, ns since 1970."""

Indices = NDArray[np.int64]
"""Indices of elements of another array, or counts."""

Bytes = NDArray[np.uint8]
"""Raw bytes of messages or of a file."""

Samples = NDArray[np.void]
"""Structured array of samples, one record per sample, with a dtype of `mwd_sensors.core.wire`."""


def joined(parts: Sequence[Samples]) -> Samples:
    """Return arrays of samples of one dtype as one array; at least one array is needed."""
    # Join the samples as raw bytes: numpy copies records field by field, which is slow.
    kind = parts[0].dtype
    return np.concatenate([part.view(f"V{kind.itemsize}") for part in parts]).view(kind)
