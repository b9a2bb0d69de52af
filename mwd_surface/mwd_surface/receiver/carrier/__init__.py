# SPDX-License-Identifier: Apache-2.0
"""Words from a phase-modulated carrier: search, blocks, code."""
