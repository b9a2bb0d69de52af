# SPDX-License-Identifier: Apache-2.0
"""
Plugin of the gate: collect the tests without the garbage collector, and run them with one that comes more rarely.

It would walk again and again through modules and tests that stay until the end: a third of the time that a worker needs
to find its tests. Afterwards it leaves them out. What the tests themselves keep (syntax trees, tables, recordings) it
would still walk through every 70 000 objects, a tenth of the time of the fast tests.
"""

import gc

# Objects between two walks through the youngest ones: Python's own 700, times 30.
_YOUNG = 21_000


def pytest_collection() -> None:
    """Let nothing be collected while all that is made stays."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Collect again, from what tests make."""
    gc.freeze()
    gc.set_threshold(_YOUNG)
    gc.enable()
