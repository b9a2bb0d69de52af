# SPDX-License-Identifier: Apache-2.0
"""Memory that a piece of work needs."""

import tracemalloc


def peak_bytes(work):
    """Return the largest memory that Python held during a call, bytes."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
