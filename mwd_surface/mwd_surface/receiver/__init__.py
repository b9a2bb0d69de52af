# SPDX-License-Identifier: Apache-2.0
"""The receiver: turns standpipe pressure into words with confidence and sigma. Free of ROS; nodes feed it."""
