# SPDX-License-Identifier: Apache-2.0
"""Signal table: every quantity once, with its name and unit on the page and in each protocol and file."""
