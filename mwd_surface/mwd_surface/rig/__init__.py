"""Rig interfaces: WITS, OPC UA, Modbus and WITSML, with one entry point."""
