# SPDX-License-Identifier: Apache-2.0
"""The survey list of a well: stations, checks, decisions, depths and legs, with its file and the well it belongs to."""
