# SPDX-License-Identifier: Apache-2.0
"""Languages of everything that people read: one catalogue for each, from the texts of the sources."""
