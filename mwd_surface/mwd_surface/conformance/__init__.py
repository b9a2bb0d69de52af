# SPDX-License-Identifier: Apache-2.0
"""Tries, as a client, whether a control authority keeps the contract of a lease: ours, or a rig's own."""
