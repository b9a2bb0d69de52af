# SPDX-License-Identifier: Apache-2.0
"""
Lease numbers that only increase, even over restarts and after the clock was set back.

A rig obeys no lease with a lower number than the highest that it has received. If a number were used twice, the rig
would ignore the second lease, or obey the wrong controller. Numbers are reserved in blocks before the first number of a
block is used: after a power cut the rest of a block is skipped, and no number is repeated.
"""

from __future__ import annotations

import json
from pathlib import Path

from mwd_sensors.core import budgets
from mwd_sensors.core.foreign_text import without_contents
from mwd_sensors.core.input_files import load_json, read_text
from mwd_sensors.core.output_files import write_whole

_BLOCK = 1000  # number of lease numbers that are reserved at a time
_LARGEST = 2**32 - 1  # largest lease number, uint32 on the wire


class LeaseNumbers:
    """Lease numbers of one well, kept in a file."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.end = 0  #: one more than the last reserved number

    def first(self, at_least: int) -> int:
        """
        Return the lowest number that no earlier lease of this well has had.

        Parameters
        ----------
        at_least : int
            Lower bound, computed from the clock, in case the file was lost.

        Raises
        ------
        ValueError
            The file cannot be read or parsed; the message says what to do.
        """
        try:
            reserved = load_json(read_text(self._file, budgets.JSON))["reserved_below"]
        except FileNotFoundError:
            reserved = 0
        except (OSError, ValueError, TypeError, KeyError) as error:
            why = without_contents(self._file, error)
            raise ValueError(f"{why}; delete it if the clock was not set back since the last lease") from error
        if type(reserved) is not int or not 0 <= reserved <= _LARGEST - _BLOCK:
            raise ValueError(
                f"{self._file}: the number in it is not valid; delete the file if the clock was not set back since the"
                " last lease"
            )
        self.end = max(reserved, at_least)
        return self.end

    def reserve(self, upcoming: int) -> None:
        """
        Reserve a block of numbers from `upcoming`, the next number, unless half a block is reserved already.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        if upcoming + _BLOCK // 2 <= self.end:
            return
        self._file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._file, json.dumps({"reserved_below": upcoming + _BLOCK}) + "\n")
        self.end = upcoming + _BLOCK
