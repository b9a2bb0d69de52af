# SPDX-License-Identifier: Apache-2.0
"""The driller's page: live state, alarms, and the server that shows them."""
