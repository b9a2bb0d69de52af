# SPDX-License-Identifier: Apache-2.0
"""Tables and lists of stations in any usual file format: one table layer, one reader, typed remarks."""
