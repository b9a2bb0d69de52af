# SPDX-License-Identifier: Apache-2.0
"""
Plugin of the gate: what tests start can be interrupted, however the gate itself was started.

A shell without job control lets a program in the background ignore SIGINT, and whatever that starts ignores it too.
"""

import signal

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
