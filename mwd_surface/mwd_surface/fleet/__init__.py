# SPDX-License-Identifier: Apache-2.0
"""Processing of many recordings (a fleet): one task per recording, one data set, and a page with all outcomes."""
