# SPDX-License-Identifier: Apache-2.0
"""Live state of a well, for the page and the rig outputs."""
