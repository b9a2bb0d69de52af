# SPDX-License-Identifier: Apache-2.0
"""Default gravity method: an error-state filter that relies on the tool's small velocity."""
