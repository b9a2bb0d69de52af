# SPDX-License-Identifier: Apache-2.0
"""The error raised for every file of rows that cannot be read as expected."""


class ListFileError(ValueError):
    """A file is not a valid list of stations; the message gives file, line and rule."""
