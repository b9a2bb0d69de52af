# SPDX-License-Identifier: Apache-2.0
"""Authority over top drive and pumps: one owner at a time, its limits, and reactions if the owner or the MWD fails."""
