# SPDX-License-Identifier: Apache-2.0
"""Processing of many recordings: one task per recording, one data set for all, and a page with the outcome of each."""
