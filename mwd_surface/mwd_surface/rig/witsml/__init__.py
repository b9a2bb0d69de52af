"""WITSML store."""
