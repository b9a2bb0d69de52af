"""Cyclic redundancy check of blocks on a carrier and of serial frames."""

from __future__ import annotations

import binascii

CRC_BYTES = 2


def crc16(data: bytes) -> int:
    """CRC-16 of polynomial 0x1021 and start 0xFFFF (ITU-T V.41; "CRC-16/IBM-3740" in catalogues)."""
    return binascii.crc_hqx(data, 0xFFFF)


def signed(data: bytes) -> bytes:
    """Bytes with their check behind them, high byte first."""
    return data + crc16(data).to_bytes(CRC_BYTES, "big")


def holds(data: bytes) -> bool:
    """Whether bytes end with their own check."""
    return len(data) > CRC_BYTES and crc16(data[:-CRC_BYTES]) == int.from_bytes(data[-CRC_BYTES:], "big")
