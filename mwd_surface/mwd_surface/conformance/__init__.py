# SPDX-License-Identifier: Apache-2.0
"""Conformance test of a control authority, ours or a rig's: tests as a client whether it keeps the lease contract."""
