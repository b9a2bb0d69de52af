# SPDX-License-Identifier: Apache-2.0
"""What the driller sees: the live state, its alarms, and the page that shows them."""
