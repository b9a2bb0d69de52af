# SPDX-License-Identifier: Apache-2.0
"""Receiver at the surface: decodes pressure, voltage or bytes into words with confidence and sigma, without ROS."""
