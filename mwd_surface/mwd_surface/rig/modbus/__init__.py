# SPDX-License-Identifier: Apache-2.0
"""Modbus TCP and RTU."""
