# SPDX-License-Identifier: Apache-2.0
"""Bottom-hole assembly: its description, its sag in the hole, and the field of its magnetised parts."""
