# SPDX-License-Identifier: Apache-2.0
"""Read the number of earlier starts of a node, which its supervisor sets in the environment."""

from __future__ import annotations

from collections.abc import Mapping

STARTS_VARIABLE = "MWD_STARTS"


def starts_before(environment: Mapping[str, str]) -> int:
    """Return the number of earlier starts of the same node by the supervisor of this process; 0 without supervisor."""
    given = environment.get(STARTS_VARIABLE, "")
    return int(given) if given.isascii() and given.isdigit() and len(given) < 10 else 0
