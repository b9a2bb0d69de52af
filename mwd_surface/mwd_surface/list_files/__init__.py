# SPDX-License-Identifier: Apache-2.0
"""Tables and lists of stations that others wrote: CSV, columns of text, LAS and WITSML, with names and units."""
