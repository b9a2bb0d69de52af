# SPDX-License-Identifier: Apache-2.0
"""The nodes of this package, and the parts the surface node is made of."""
