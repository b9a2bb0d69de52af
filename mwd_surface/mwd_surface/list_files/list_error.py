# SPDX-License-Identifier: Apache-2.0
"""The error of every file of rows that is not what it should be."""


class ListFileError(ValueError):
    """A file that is not a list of stations; the message gives file, line and rule."""
