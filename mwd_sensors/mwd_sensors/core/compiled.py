# SPDX-License-Identifier: Apache-2.0
"""Compile kernels with numba, with a cache that is renewed when any module that a kernel uses changes."""

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
    Kernel for numba before 0.61, which compares named tuples by uninitialised memory (numba issue 9097).

    With numba's own lookup each call would leak some hundred bytes and could pick the code of another type. This class
    therefore looks up the machine code of calls with named tuples itself.
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

    The function must use scalars, numpy arrays and loops only (no Python objects, no ``@``: for small arrays loops are
    faster than matrix products). The machine code is cached next to the module. It is rebuilt when the module changes,
    or any module that its names come from. Floating point stays strict (no fast-math), so that a block of samples gives
    the same bits as the same samples one by one. The kernel releases the interpreter lock; other threads must not touch
    the arrays of a call until it returns.
    """
    kernel = _njit(cache=True, fastmath=False, nogil=True)(function)
    # numba checks the kernel's own file only and would keep the old machine code of a changed function that it calls.
    index = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
    if index is not None:
        index._source_stamp = (index._source_stamp, _stamps(function.__module__))
        index._load_index = _or_none(index._load_index)
        kernel.compile = _one_at_a_time(kernel.compile, Path(index._cache_path), index._index_name)
    # Without this, numba compiles a called kernel again for every literal argument (0, 1): a fifth of all compile time.
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
    """Call `report` once, before the first kernel that is not in the cache is compiled within this context."""
    waiting = [report]

    class First(_event.Listener):  # type: ignore[misc]
        def on_start(self, _: object) -> None:
            if waiting:
                waiting.pop()()

        def on_end(self, _: object) -> None:
            """Ignore the end of a compilation."""

    with _event.install_listener("numba:compile", First()):
        yield


def _one_at_a_time(compile_: Callable[[Any], Any], folder: Path, name: str) -> Callable[[Any], Any]:
    """
    Wrap a compile function so that only one process compiles a kernel; others wait and then read it from the cache.

    Without this, nodes and test workers that start together would each compile the same kernels for minutes.
    """
    # A kernel waits only for kernels that it calls, so processes cannot wait for each other in a circle. They could if
    # two names share a lock byte; the system detects that deadlock and refuses the lock.
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
    """
    Open the lock file of a cache folder, in which one byte stands for each kernel, and return its descriptor.

    Returns None when the file cannot be opened.
    """
    try:
        # Never closed: when a process closes a file, it loses all its locks on that file.
        return os.open(folder / "compiling.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError:
        return None


def _or_none(load: Callable[[], dict[Any, str]]) -> Callable[[], dict[Any, str]]:
    """Load the cache's index, or an empty one if the index names a module or type that no longer exists or differs."""

    def loaded() -> dict[Any, str]:
        try:
            return load()
        except (ImportError, AttributeError, TypeError):
            return {}

    return loaded


@functools.cache
def _stamps(name: str) -> tuple[tuple[str, int, int], ...]:
    """Return name, time of change and size of the files of a module and of all our modules that its names come from."""
    seen: set[str] = set()
    waiting = [name]
    while waiting:
        at = waiting.pop()
        module = sys.modules.get(at)
        if module is None or at in seen:
            continue
        seen.add(at)
        if hasattr(module, "__path__"):
            # The names in a package are whatever modules were imported so far, which differs from process to process.
            continue
        for value in list(vars(module).values()):
            # Values that a kernel can use: modules, other kernels, enumerations and named tuples of settings.
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
    """Return the properties of an argument from which numba derives its type."""
    if isinstance(arg, tuple):
        return type(arg), *map(_kind, arg)
    if isinstance(arg, np.ndarray | np.void):
        return type(arg), arg.dtype, arg.ndim, arg.flags.num
    return type(arg)
