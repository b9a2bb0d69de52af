# SPDX-License-Identifier: Apache-2.0
"""Conformance test of the control authority of this project or of a rig: a client tests whether it keeps the rules."""
