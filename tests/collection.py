# SPDX-License-Identifier: Apache-2.0
"""
Plugin of the gate: collect the tests without the garbage collector.

It would walk again and again through modules and tests that stay until the end: a third of the time that a worker needs
to find its tests. Afterwards it leaves them out.
"""

import gc


def pytest_collection() -> None:
    """Let nothing be collected while all that is made stays."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Collect again, from what tests make."""
    gc.freeze()
    gc.enable()
