# SPDX-License-Identifier: Apache-2.0
"""WITS level 0 interfaces."""
