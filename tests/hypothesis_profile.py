# SPDX-License-Identifier: Apache-2.0
"""Plugin of the gate: property tests give the same answer each time and no verdict on the machine's speed."""

import os

from hypothesis import HealthCheck, settings

settings.register_profile("gate", deadline=None, derandomize=True)
# `make fuzz`: other input each time, and much more of it.
settings.register_profile(
    "fuzz",
    deadline=None,
    max_examples=int(os.environ.get("FUZZ_INPUTS", "5000")),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "gate"))
