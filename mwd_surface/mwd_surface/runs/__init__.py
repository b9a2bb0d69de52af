# SPDX-License-Identifier: Apache-2.0
"""Complete tasks of commands: simulate, calibrate, play back, supervise nodes, check the machine."""
