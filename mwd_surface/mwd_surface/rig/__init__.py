"""What rig control hears and says: WITS, OPC UA, Modbus, WITSML, behind one port."""
