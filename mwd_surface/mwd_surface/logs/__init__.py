# SPDX-License-Identifier: Apache-2.0
"""Logs over depth: samples of log channels merged by depth, shifted against each other, and written to files."""
