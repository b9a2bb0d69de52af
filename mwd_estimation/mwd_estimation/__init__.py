# SPDX-License-Identifier: Apache-2.0
"""Estimation in the tool: gravity while drilling, attitude, north, magnetic interference, quality, uncertainty."""

from __future__ import annotations

import importlib
from typing import Any

_MODULES = {
    "EstimatorSettings": "settings.estimator",
    "Pipeline": "pipeline.pipeline",
    "Place": "settings.place",
    "Reference": "core.reference_field",
}


def __getattr__(name: str) -> Any:
    """Import the entry points of the library on first use only, because the pipeline imports every filter."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
