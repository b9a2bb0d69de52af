# SPDX-License-Identifier: Apache-2.0
"""Many recordings at once: one task a bag, one data set of all of them, and a page that lists what came of each."""
