# SPDX-License-Identifier: Apache-2.0
"""Client of a WITSML store."""
