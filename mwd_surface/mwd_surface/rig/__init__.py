# SPDX-License-Identifier: Apache-2.0
"""Rig interfaces: WITS, OPC UA, Modbus and WITSML, started and fed through one entry point."""
