# SPDX-License-Identifier: Apache-2.0
"""The default gravity method: an error-state filter bounded by the tool's small velocity."""
