# SPDX-License-Identifier: Apache-2.0
"""Cyclic redundancy check of blocks on a carrier and of serial frames."""

from __future__ import annotations

import binascii

CRC_BYTES = 2


START = 0xFFFF  # usual start value of the CRC register


def crc16(data: bytes, start: int = START) -> int:
    """
    Return the CRC-16 with polynomial 0x1021 (ITU-T V.41).

    With the default start value the CRC is called CRC-16/IBM-3740 in catalogues.
    """
    return binascii.crc_hqx(data, start)


def signed(data: bytes, start: int = START) -> bytes:
    """
    Return bytes with the check appended, high byte first.

    The check is valid only for a receiver with the same start value. A start value that depends on the configuration
    therefore rejects data from a tool with another configuration.
    """
    return data + crc16(data, start).to_bytes(CRC_BYTES, "big")


def holds(data: bytes, start: int = START) -> bool:
    """Return whether bytes end with a valid check."""
    return len(data) > CRC_BYTES and crc16(data[:-CRC_BYTES], start) == int.from_bytes(data[-CRC_BYTES:], "big")
