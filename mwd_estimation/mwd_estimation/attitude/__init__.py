"""Attitude of every sample between and during surveys."""
