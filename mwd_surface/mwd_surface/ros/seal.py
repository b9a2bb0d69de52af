# SPDX-License-Identifier: Apache-2.0
"""
Seals that identify the sender of a message on the ROS graph, because rclpy does not identify senders.

In rclpy 7.1 a subscription does not get the GID of the publisher, and a service does not get the GID of its client. A
lease number, which everyone can read, is not a proof of identity. The owner of a lease is therefore identified by its
own key: it signs its messages, and the lease is bound to the public key. A signature covers the name of the topic or
service, an increasing count, and the content; a message that another node sends again is refused.
"""

from __future__ import annotations

import collections
import struct
import time
from typing import Any

import numpy as np
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

_MOST_KEYS = 10_000  # largest number of keys whose last count is kept
_REMEDY = "see 'Who commands' in docs/rig/control.md"


class SealError(ValueError):
    """Raised for a message whose sender cannot be identified; the text gives the reason."""


def signed_bytes(name: str, count: int, sealed: Any) -> bytes:
    """
    Return the bytes that a seal signs.

    The bytes are: name of the topic or service, count (uint64), then each field of the message in order, without header
    and seal; the fields of a nested message stand at the place of this message. A text is encoded as its length
    (uint32) and UTF-8, a bool or integer as int64, a float as float64, all little-endian.
    """
    return _text(name) + struct.pack("<Q", count) + b"".join(_content(sealed))


def _text(value: str) -> bytes:
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def _content(message: Any) -> list[bytes]:
    parts = []
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if name in ("seal", "header"):
            continue
        if isinstance(value, str):
            parts.append(_text(value))
        elif isinstance(value, float):
            parts.append(struct.pack("<d", value))
        elif isinstance(value, int):
            parts.append(struct.pack("<q", value))
        else:
            parts += _content(value)
    return parts


class Sealer:
    """
    Signer of one controller's messages.

    Parameters
    ----------
    private_key : bytes, optional
        Secret key of 32 bytes; by default a new random key, so that this identity belongs to this run of this sender
        only.
    """

    def __init__(self, private_key: bytes | None = None) -> None:
        self._private = Ed25519PrivateKey.generate()
        if private_key is not None:
            self._private = Ed25519PrivateKey.from_private_bytes(private_key)
        self._key = self._private.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)
        self._count = 0

    def seal(self, name: str, message: Any) -> Any:
        """Fill the field `seal` of a message for a topic or service (full name), and return the message."""
        # Use the clock, so that the count also increases after a restart of a controller that keeps its key.
        self._count = max(self._count + 1, time.time_ns())
        signature = self._private.sign(signed_bytes(name, self._count, message))
        message.seal.key, message.seal.signature = (np.frombuffer(b, np.uint8) for b in (self._key, signature))
        message.seal.count = self._count
        return message


class SealChecker:
    """Verifier of the senders of sealed messages; each message is accepted once."""

    def __init__(self) -> None:
        self._counts: collections.OrderedDict[bytes, int] = collections.OrderedDict()

    def key_of(self, name: str, message: Any) -> str:
        """
        Return the public key of the sender in hexadecimal digits.

        Raises
        ------
        SealError
            The message has no seal, the seal does not match the content, or the message was received before.
        """
        seal = message.seal
        key, signature = bytes(seal.key), bytes(seal.signature)
        if not any(signature):
            raise SealError(f"seal: the message is not signed, so its sender is unknown; {_REMEDY}")
        try:
            Ed25519PublicKey.from_public_bytes(key).verify(signature, signed_bytes(name, seal.count, message))
        except (InvalidSignature, ValueError) as error:
            raise SealError(f"seal: the signature does not match this message and key; {_REMEDY}") from error
        if seal.count <= self._counts.get(key, 0):
            raise SealError(f"seal: count {seal.count} was already used: each message is accepted once; {_REMEDY}")
        self._counts[key] = seal.count
        self._counts.move_to_end(key)
        while len(self._counts) > _MOST_KEYS:
            self._counts.popitem(last=False)
        return key.hex()
