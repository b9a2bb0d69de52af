# SPDX-License-Identifier: Apache-2.0
"""Bottom-hole assembly: its description, and its sag in the hole."""
