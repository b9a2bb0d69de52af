# SPDX-License-Identifier: Apache-2.0
"""Building blocks of every node: lifecycle, parameters, QoS profiles, message buffers."""
