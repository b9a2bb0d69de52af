# SPDX-License-Identifier: Apache-2.0
"""
Record types of compiled kernels, declared as annotated classes.

The state of a kernel is one element of a structured array. Its class names every field once, with type and shape. The
type checker reads the class, numba and numpy use the dtype made from it, and in both a field is written `s.name`:

    class Ring(...):                           RING = dtype_of(Ring)
        head: int                              state = np.zeros(1, RING)
        down: Annotated[Array, 512, 3]         step(params, state[0], ...)

A record is passed to a kernel by reference. To copy, save, compare or reset a state, use the one-element array.
"""

from __future__ import annotations

import typing
from typing import Annotated, Any

import numpy as np

_SCALARS = {float: np.float64, int: np.int64, bool: np.bool_}


def dtype_of(description: type) -> np.dtype[Any]:
    """
    Return the aligned record dtype with the fields of an annotated class, in their order.

    Parameters
    ----------
    description : type
        Class whose annotations are float (float64), int (int64), bool, a numpy scalar type, another such class, or
        `Annotated[kind, *shape]` with `kind` an `NDArray` type or `Sequence` of another such class.

    Returns
    -------
    numpy.dtype
        The dtype, of `numpy.record`, so that `record.name` works outside kernels too.
    """
    fields: list[tuple[str, Any]] = []
    for name, hint in typing.get_type_hints(description, include_extras=True).items():
        kind, shape = hint, ()
        if typing.get_origin(hint) is Annotated:
            kind, *lengths = typing.get_args(hint)
            shape = tuple(lengths)
            # NDArray[T] is ndarray[shape, dtype[T]], Sequence[T] has one argument.
            kind = typing.get_args(kind)[-1]
            kind = typing.get_args(kind)[0] if typing.get_origin(kind) is np.dtype else kind
        scalar = _SCALARS.get(kind, kind)
        element = np.dtype(scalar) if issubclass(scalar, np.generic) else dtype_of(scalar)
        fields.append((name, np.dtype((element, shape))))
    return _aligned(fields)


def _aligned(fields: list[tuple[str, np.dtype[Any]]]) -> np.dtype[Any]:
    """Return a record dtype with every field aligned; numpy itself would align a nested record to 1 byte."""
    offsets, end = [], 0
    for _, dtype in fields:
        step = _alignment(dtype)
        offsets.append(-(-end // step) * step)
        end = offsets[-1] + dtype.itemsize
    step = max(_alignment(dtype) for _, dtype in fields)
    layout: Any = {
        "names": [name for name, _ in fields],
        "formats": [dtype for _, dtype in fields],
        "offsets": offsets,
        "itemsize": -(-end // step) * step,
    }
    return np.dtype((np.record, np.dtype(layout, align=True)))


def _alignment(dtype: np.dtype[Any]) -> int:
    """Return the alignment of the largest scalar in a dtype, bytes."""
    if dtype.subdtype is not None:
        return _alignment(dtype.subdtype[0])
    if dtype.fields is not None:
        return max(_alignment(field[0]) for field in dtype.fields.values())
    return dtype.alignment
