# SPDX-License-Identifier: Apache-2.0
"""Cyclic redundancy check of blocks on a carrier and of serial frames."""

from __future__ import annotations

import binascii

CRC_BYTES = 2


START = 0xFFFF


def crc16(data: bytes, start: int = START) -> int:
    """CRC-16 of polynomial 0x1021 and start 0xFFFF (ITU-T V.41; "CRC-16/IBM-3740" in catalogues)."""
    return binascii.crc_hqx(data, start)


def signed(data: bytes, start: int = START) -> bytes:
    """
    Bytes with their check behind them, high byte first.

    start: what tool and surface must have in common; the check holds only for a receiver with the same.
    """
    return data + crc16(data, start).to_bytes(CRC_BYTES, "big")


def holds(data: bytes, start: int = START) -> bool:
    """Whether bytes end with their own check."""
    return len(data) > CRC_BYTES and crc16(data[:-CRC_BYTES], start) == int.from_bytes(data[-CRC_BYTES:], "big")
