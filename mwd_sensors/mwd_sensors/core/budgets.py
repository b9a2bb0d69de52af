# SPDX-License-Identifier: Apache-2.0
"""
Size limits for every reader of files and network peers. A reader stops with a clear message at its limit.

Readers use memory and time in proportion to the size of their input. The budget limits the cases where a small input
demands much more: compression, aliases, repeated chunks, time stamps far apart and deep nesting. SECURITY.md shows the
same table.
"""

from __future__ import annotations

import dataclasses

MB = 1_000_000


class BudgetError(ValueError):
    """An input exceeds its budget; the message names the quantity and the limit."""


@dataclasses.dataclass(frozen=True)
class Budget:
    """Limits of one reader. None means that a quantity has no limit of its own."""

    reads: str  #: inputs that the budget applies to
    size: int  #: largest number of bytes that are read
    unpacked: int | None = None  #: largest size of one piece after decompression, bytes
    records: int | None = None  #: largest number of rows, values, samples or records
    columns: int | None = None  #: largest number of fields of a row, or of lines of a header
    seconds: float | None = None  #: longest time from the first record to the last, s
    nesting: int | None = None  #: largest number of levels of nesting

    def check(self, what: str, amount: float) -> None:
        """
        Check an amount against the limit `what`, the name of an attribute of this class.

        Raises
        ------
        BudgetError
            The amount is above the limit.
        """
        most = getattr(self, what)
        if most is not None and amount > most:
            raise BudgetError(f"{_WORDS[what].format(f'{amount:.6g}')}: at most {most:.6g} are read")

    def check_ratio(self, packed: int, unpacked: int) -> None:
        """
        Compare the total decompressed size of a file with the size of the file.

        Raises
        ------
        BudgetError
            The decompressed size is more than `FREE` bytes plus `RATIO` times the size of the file.
        """
        most = FREE + RATIO * packed
        if unpacked > most:
            raise BudgetError(
                f"unpacks to {unpacked / MB:.6g} MB or more: a file of {packed / MB:.3g} MB may unpack to"
                f" {most / MB:.6g} MB"
            )


_WORDS = {
    "size": "has {} bytes",
    "unpacked": "has a piece of {} bytes unpacked",
    "records": "has {} records",
    "columns": "has {} columns or header lines",
    "seconds": "goes over {} s",
    "nesting": "is nested {} levels deep",
}

FREE, RATIO = 256 * MB, 200
"""A compressed file may decompress to FREE bytes plus RATIO times its size. Sensor noise compresses less than tenfold,
equal messages of a topic up to a hundredfold."""

YAML = Budget(
    "YAML: scenarios, settings, tools, plans, calibrations, metadata of bags", 5 * MB, records=200_000, nesting=50
)
JSON = Budget("JSON: survey lists, slide sheets, memories of the nodes", 50 * MB, nesting=100)
LIST = Budget("station lists and tables: CSV, text, LAS, WITSML", 20 * MB, records=200_000, columns=500)
SPREADSHEET = Budget(
    "spreadsheets (.xlsx): all that is packed; records are cells, also empty ones; 200 sheets, 100 000 other elements",
    20 * MB,
    unpacked=100 * MB,
    records=5_000_000,
    columns=500,
)
PRESSURE = Budget(
    "pressure of a CSV or WAV, pump strokes", 2000 * MB, records=50_000_000, columns=500, seconds=30 * 86_400.0
)
PRESSURE_JSON = Budget(
    "pressure of JSON: bytes of a document or of a line of many; records are cells, also empty ones",
    50 * MB,
    records=200_000_000,
    columns=500,
    nesting=100,
)
SERIAL = Budget("captured bytes of a serial line", 200 * MB)
OBSERVATORY = Budget("observatory record (IAGA-2002)", 250 * MB)
SECRET = Budget("tokens and passwords", 10_000)
CERTIFICATE = Budget("certificates and keys", MB)
LOGO = Budget("logo of a report", 5 * MB)
MCAP = Budget("recording: MCAP", 2**63 - 1, unpacked=64 * 2**20, records=500_000)
DATABASE = Budget("recording: db3 (SQLite)", 2**63 - 1, unpacked=64 * 2**20)
ROS1 = Budget("recording: ROS 1 bag", 2**63 - 1, unpacked=64 * 2**20)
RUN = Budget("results of a run: CSV, Parquet", 2**63 - 1, records=500_000_000)
PAGE = Budget("request to the page", 16 * 1024, nesting=100)
WITSML_STORE = Budget("answer of a WITSML store or a blackboard", 2**20, nesting=100)
OPCUA = Budget("message to the OPC UA server", 2**20)
WITS = Budget("frame of a WITS peer", 65_536)
