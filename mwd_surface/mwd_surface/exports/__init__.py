# SPDX-License-Identifier: Apache-2.0
"""Surveys and recordings as files for others: tables, LAS, WITSML, reports."""
