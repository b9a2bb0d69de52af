# SPDX-License-Identifier: Apache-2.0
"""Input for attacks on parsers: valid input that was damaged, and bytes of no origin."""

from __future__ import annotations

from hypothesis import strategies as st

# Numbers that lengths and counts are replaced with: ends of ranges, and what overflows when it is added to or doubled.
_LENGTHS = (0, 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**60, 2**63 - 1, 2**64 - 1)


@st.composite
def damaged(draw: st.DrawFn, samples: list[bytes]) -> bytes:
    """One of the samples after one to four of: flipped byte, hostile length, cut, repeated part, foreign bytes."""
    data = bytearray(draw(st.sampled_from(samples)))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(len(data) - 1, 0)))
        kind = draw(st.sampled_from(("flip", "length", "cut", "repeat", "foreign")))
        if kind == "flip" and data:
            data[at] ^= draw(st.integers(1, 255))
        elif kind == "length":
            size = draw(st.sampled_from((2, 4, 8)))
            value = draw(st.sampled_from(_LENGTHS)) % (1 << 8 * size)
            data[at : at + size] = value.to_bytes(size, draw(st.sampled_from(("little", "big"))))
        elif kind == "cut":
            del data[at:]
        elif kind == "repeat":
            data[at:at] = data[at : at + draw(st.integers(1, 64))] * draw(st.integers(1, 20))
        else:
            data[at:at] = draw(st.binary(max_size=32))
    return bytes(data)


def attacks(*samples: bytes) -> st.SearchStrategy[bytes]:
    """Damaged samples mostly, and bytes of no origin."""
    return st.one_of(damaged(list(samples)), damaged(list(samples)), st.binary(max_size=512))
