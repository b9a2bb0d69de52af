"""Calibration of a tool: Allan variance, tumble fit, compensation of a stream."""
