# SPDX-License-Identifier: Apache-2.0
"""
Plugin of the gate: linear algebra in one thread, as `mwd` has it.

Each worker's OpenBLAS would start a thread for each core, which wait for each other longer than they work. OpenBLAS
reads the variable when numpy is first imported: this plugin is loaded before anything that imports numpy.
"""

from mwd_sensors.core.linear_algebra import use_one_thread

use_one_thread()
