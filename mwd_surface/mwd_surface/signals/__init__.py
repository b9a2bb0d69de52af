# SPDX-License-Identifier: Apache-2.0
"""Signals: every quantity once, with its name and unit on the page and in each protocol and file."""
