# SPDX-License-Identifier: Apache-2.0
"""The survey list of a well: stations and their checks, decisions, depths, legs, its file, the well it belongs to."""
