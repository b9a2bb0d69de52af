# SPDX-License-Identifier: Apache-2.0
"""Linear algebra of a process of the graph in one thread."""

import os


def use_one_thread() -> None:
    """
    Let OpenBLAS use one thread unless OPENBLAS_NUM_THREADS says otherwise; called before numpy is first imported.

    Matrices have some tens of rows: the threads of OpenBLAS wait for each other longer than they work.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
