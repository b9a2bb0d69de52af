# SPDX-License-Identifier: Apache-2.0
"""
Numbers of leases that only grow, over restarts and a clock that was set back.

A rig obeys no lease older than the newest it has seen, so that a number given twice would be ignored or, worse, obeyed
for another controller. Numbers are reserved in blocks before the first of a block is given: a power cut skips the rest
of a block and repeats none.
"""

from __future__ import annotations

import json
from pathlib import Path

from mwd_sensors.core import budgets
from mwd_sensors.core.foreign_text import without_contents
from mwd_sensors.core.input_files import load_json, read_text
from mwd_sensors.core.output_files import write_whole

_BLOCK = 1000
_LARGEST = 2**32 - 1  # uint32 on the wire


class LeaseNumbers:
    """
    The numbers of one well, in a file.

    Parameters
    ----------
    file : Path

    Attributes
    ----------
    end : int
        One beyond the last number that is reserved.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self.end = 0

    def first(self, at_least: int) -> int:
        """
        First number that no earlier lease of this well has had.

        at_least : int
            From where on; the clock, for a file that is lost.

        Raises
        ------
        ValueError
            The file cannot be read or understood; the message says what to do.
        """
        try:
            reserved = load_json(read_text(self._file, budgets.JSON))["reserved_below"]
        except FileNotFoundError:
            reserved = 0
        except (OSError, ValueError, TypeError, KeyError) as error:
            why = without_contents(self._file, error)
            raise ValueError(f"{why}; delete it if no lease is newer than the clock") from error
        if type(reserved) is not int or not 0 <= reserved <= _LARGEST - _BLOCK:
            raise ValueError(f"{self._file}: no such number; delete it if no lease is newer than the clock")
        self.end = max(reserved, at_least)
        return self.end

    def reserve(self, upcoming: int) -> None:
        """
        Keep a block ahead of the number that is given next; to be called before it is given.

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
