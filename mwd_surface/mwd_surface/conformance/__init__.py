# SPDX-License-Identifier: Apache-2.0
"""Conformance test of a control authority, of this project or of a rig: clients of its interfaces test its rules."""
