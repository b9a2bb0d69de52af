# SPDX-License-Identifier: Apache-2.0
"""OPC UA server of a well."""
