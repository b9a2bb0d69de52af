# SPDX-License-Identifier: Apache-2.0
"""Surveys and recordings as files for other programs and for people: tables, LAS, WITSML, reports."""
