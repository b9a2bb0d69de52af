# SPDX-License-Identifier: Apache-2.0
"""Tables and lists of stations that others wrote, in any usual file: one table layer, one reader, typed remarks."""
