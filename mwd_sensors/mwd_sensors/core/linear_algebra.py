# SPDX-License-Identifier: Apache-2.0
"""Limit the linear algebra of a process to one thread."""

import os


def use_one_thread() -> None:
    """
    Let OpenBLAS use one thread unless OPENBLAS_NUM_THREADS is set; call this before numpy is first imported.

    Matrices here have some tens of rows: with several threads OpenBLAS spends more time waiting than computing.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
