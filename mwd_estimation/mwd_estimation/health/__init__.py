"""Sensor health: which unit or axis reads wrongly, and why."""
