# SPDX-License-Identifier: Apache-2.0
"""The live state of the well, which the page and the rig outputs read."""
