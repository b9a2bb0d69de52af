# SPDX-License-Identifier: Apache-2.0
"""Compilation of kernels by numba, with a cache that follows every module they take names from."""

from __future__ import annotations

import contextlib
import enum
import fcntl
import functools
import os
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
from numba import njit as _njit
from numba import version_info as _version
from numba.core import event as _event
from numba.core.registry import CPUDispatcher as _Dispatcher
from numba.core.types.misc import unliteral as _unliteral

F = TypeVar("F", bound=Callable[..., Any])


class _OldDispatcher(_Dispatcher):  # type: ignore[misc]
    """
    A kernel for numba before 0.61, which tells named tuples apart by memory it has not written (its issue 9097).

    Each call would keep some hundred bytes for good, and could take one type for another. So the machine code for
    named tuples is looked up here.
    """

    def __call__(self, *args: Any, **keywords: Any) -> Any:
        if keywords or not any(isinstance(arg, tuple) for arg in args):
            return super().__call__(*args, **keywords)
        kinds = tuple(map(_kind, args))
        entry = self.entries.get(kinds)
        if entry is None:
            entry = self.entries[kinds] = self.compile(tuple(map(self.typeof_pyval, args)))
        return entry(*args)


_OURS = "mwd_"


def compiled(function: F) -> F:
    """
    Compile an explicit-loop kernel to machine code.

    The function must use scalars, numpy arrays and loops only (no Python objects, no ``@``: matrix products of
    small arrays are slower than loops there). The machine code is cached beside the module, and rebuilt when the
    module changes or one that its names come from. Floating point stays strict (no fast-math), so that a block of
    samples gives the same bits as the samples one by one. Other threads run meanwhile, so the arrays of one call belong
    to it until it returns.
    """
    kernel = _njit(cache=True, fastmath=False, nogil=True)(function)
    # numba looks at the kernel's own file only; machine code of a callee that has changed since would live on in it.
    index = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
    if index is not None:
        index._source_stamp = (index._source_stamp, _stamps(function.__module__))
        index._load_index = _or_none(index._load_index)
        kernel.compile = _one_at_a_time(kernel.compile, Path(index._cache_path), index._index_name)
    # Called by another kernel with 0 here and 1 there it would be compiled for each: a fifth of all compiling.
    by_type = kernel.get_call_template
    kernel.get_call_template = lambda args, keywords: by_type(
        tuple(map(_unliteral, args)), {name: _unliteral(kind) for name, kind in keywords.items()}
    )
    if _version.short < (0, 61):
        kernel.__class__ = _OldDispatcher
        kernel.entries = {}
    return kernel  # type: ignore[no-any-return]


@contextlib.contextmanager
def when_compiling(report: Callable[[], None]) -> Iterator[None]:
    """Within this, call `report` before the first kernel that is in no cache and has to be compiled; then no more."""
    waiting = [report]

    class First(_event.Listener):  # type: ignore[misc]
        def on_start(self, _: object) -> None:
            if waiting:
                waiting.pop()()

        def on_end(self, _: object) -> None:
            """Of no interest."""

    with _event.install_listener("numba:compile", First()):
        yield


def _one_at_a_time(compile_: Callable[[Any], Any], folder: Path, name: str) -> Callable[[Any], Any]:
    """
    Compile a kernel in one process at a time: another that needs it waits, and then takes it from the cache.

    Nodes and test workers that start together would each compile the same kernels, for minutes.
    """
    # A kernel waits for those it calls only, so that processes do not wait for each other in a circle; where two names
    # share a place they could, which the system notices and refuses.
    place = zlib.crc32(name.encode())

    def compiled_once(signature: Any) -> Any:
        file = _lock_file(folder)
        if file is None:
            return compile_(signature)
        locked = False
        with contextlib.suppress(OSError):
            fcntl.lockf(file, fcntl.LOCK_EX, 1, place)
            locked = True
        try:
            return compile_(signature)
        finally:
            if locked:
                fcntl.lockf(file, fcntl.LOCK_UN, 1, place)

    return compiled_once


@functools.cache
def _lock_file(folder: Path) -> int | None:
    """Descriptor of a file whose bytes stand for the kernels of a folder of the cache; None where none can be had."""
    try:
        # Open for good: a process that closes a file gives up all its locks on it.
        return os.open(folder / "compiling.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError:
        return None


def _or_none(load: Callable[[], dict[Any, str]]) -> Callable[[], dict[Any, str]]:
    """Cache's index, empty where it names a module or a type that an earlier version had and this one has not."""

    def loaded() -> dict[Any, str]:
        try:
            return load()
        except (ImportError, AttributeError):
            return {}

    return loaded


@functools.cache
def _stamps(name: str) -> tuple[tuple[str, int, int], ...]:
    """Name, change and size of the files of a module and of all of ours that its names come from, near and far."""
    seen: set[str] = set()
    waiting = [name]
    while waiting:
        at = waiting.pop()
        module = sys.modules.get(at)
        if module is None or at in seen:
            continue
        seen.add(at)
        if hasattr(module, "__path__"):
            # A package's names are whatever has been imported of it so far.
            continue
        for value in list(vars(module).values()):
            # What a kernel can use: modules, other kernels, names of numbers, and tuples of settings with named fields.
            usable = hasattr(value, "py_func") or (isinstance(value, type) and issubclass(value, (enum.Enum, tuple)))
            source = value.__name__ if isinstance(value, ModuleType) else value.__module__ if usable else ""
            if source.startswith(_OURS):
                waiting.append(source)
    found = []
    for at in sorted(seen):
        file = getattr(sys.modules[at], "__file__", None)
        if file is not None and Path(file).exists():
            about = Path(file).stat()
            found.append((at, about.st_mtime_ns, about.st_size))
    return tuple(found)


def _kind(arg: Any) -> Any:
    """What numba makes the type of an argument from."""
    if isinstance(arg, tuple):
        return type(arg), *map(_kind, arg)
    if isinstance(arg, np.ndarray | np.void):
        return type(arg), arg.dtype, arg.ndim, arg.flags.num
    return type(arg)
