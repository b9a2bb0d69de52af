# SPDX-License-Identifier: Apache-2.0
"""The survey list of a well: stations, decisions, depths, the path and the plan, and how well they are known."""
