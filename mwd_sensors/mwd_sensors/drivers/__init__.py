# SPDX-License-Identifier: Apache-2.0
"""Drivers of real sensors: serial protocols, clock synchronisation, and an emulator that plays recordings."""
