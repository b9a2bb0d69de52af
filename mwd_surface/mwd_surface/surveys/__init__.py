# SPDX-License-Identifier: Apache-2.0
"""The survey list of a well: stations, checks, decisions, depths and legs, its file, and the settings of the well."""
