# SPDX-License-Identifier: Apache-2.0
"""What every node of the graph is built from: lifecycle, parameters, QoS, message buffers."""
