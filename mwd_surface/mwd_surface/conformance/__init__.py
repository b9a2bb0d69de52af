# SPDX-License-Identifier: Apache-2.0
"""Conformance test of a control authority, of this project or of a rig: a client tests whether it follows its rules."""
