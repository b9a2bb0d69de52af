"""Stations and surveys: averages, corrections, fusion, verdict."""
