# SPDX-License-Identifier: Apache-2.0
"""The error raised if a list of stations or a table cannot be read."""


class ListFileError(ValueError):
    """Raised if a file is not a valid list or table; the message gives file, line and rule."""
