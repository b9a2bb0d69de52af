# SPDX-License-Identifier: Apache-2.0
"""Stations and surveys: averages, corrections, fusion, verdict."""
