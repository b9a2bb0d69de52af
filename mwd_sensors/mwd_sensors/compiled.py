"""One door to numba, so that every kernel works, slower, where numba is absent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

try:
    from numba import njit as _njit
except ImportError:
    HAVE_NUMBA = False
else:
    HAVE_NUMBA = True


def compiled(function: F) -> F:
    """
    Compile an explicit-loop kernel to machine code, or hand it back unchanged.

    The function must use scalars, numpy arrays and loops only (no Python objects, no ``@``: matrix products of
    small arrays are slower than loops there). The machine code is cached beside the module. Floating point stays
    strict (no fast-math), so that a block of samples gives the same bits as the samples one by one. Other threads run
    meanwhile, so the arrays of one call belong to it until it returns.
    """
    if not HAVE_NUMBA:
        return function
    return _njit(cache=True, fastmath=False, nogil=True)(function)  # type: ignore[no-any-return]
