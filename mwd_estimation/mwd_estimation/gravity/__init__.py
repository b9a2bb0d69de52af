"""Gravity in tool axes while the string rotates and vibrates: one module per method."""
