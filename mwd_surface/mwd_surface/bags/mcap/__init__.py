# SPDX-License-Identifier: Apache-2.0
"""MCAP files: format, index, writer, recovery."""
