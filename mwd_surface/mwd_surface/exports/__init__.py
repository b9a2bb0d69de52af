"""Surveys and recordings as files for others: tables, LAS, WITSML, reports."""
