"""Azimuth from the Earth rate: seeks, filters and their posterior."""
