# SPDX-License-Identifier: Apache-2.0
"""Compile kernels with numba, with a cache that is renewed when any module that a kernel uses changes."""

from __future__ import annotations

import contextlib
import enum
import fcntl
import functools
import hashlib
import os
import shutil
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numba
import numpy as np
from numba import types
from numba.core import event
from numba.core.registry import CPUDispatcher

F = TypeVar("F", bound=Callable[..., Any])

_OURS = "mwd_"
_UNUSED_S = 30 * 86400.0  # a cache folder of another installation is removed if no process used it for this time, s


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """
    Compiled function that shares its machine code with other processes, through a cache on disk.

    numba's own cache checks only the file of the kernel itself. After a change in the file of a called function it
    would return the old machine code. Here the name of the cache folder contains a hash over time and size of the files
    of all modules that the kernel uses.
    """

    folder: Path | None = None
    specialised = False  # whether the kernel is compiled for each call, see the function `specialised`

    def enable_caching(self) -> None:
        """Cache the machine code in the cache folder of the kernel's module, if that folder can be written."""
        self.folder = _cache_folder(self.py_func.__module__)
        if self.folder is not None:
            before = numba.config.CACHE_DIR
            numba.config.CACHE_DIR = str(self.folder)
            try:
                super().enable_caching()
            finally:
                numba.config.CACHE_DIR = before

    def compile(self, sig: Any) -> Any:
        """
        Return the machine code for argument types, from the cache if another process has compiled it.

        A cache that names types that no longer exist is deleted, and the kernel is compiled again.
        """
        with self._alone():
            try:
                return super().compile(sig)
            except (ImportError, AttributeError, TypeError):
                if self.folder is None:
                    raise
                # An entry of the cache names a type that no longer exists or has other fields.
                shutil.rmtree(self.folder, ignore_errors=True)
                return super().compile(sig)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """
        Return numba's template of a call from another kernel, for the types of the arguments, not their literal values.

        numba would compile one more version for each literal argument (0, 1), a fifth of the total compilation time.
        Only `specialised` kernels need these versions.
        """
        if self.specialised:
            return super().get_call_template(args, kws)
        return super().get_call_template(
            tuple(map(types.unliteral, args)), {name: types.unliteral(kind) for name, kind in kws.items()}
        )

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """
        Let only one process compile this kernel; other processes wait and then read the machine code from the cache.

        Without this lock, nodes and test workers that start together would each compile the same kernels for minutes.
        Without a cache folder, or if the system refuses the lock, the process compiles without waiting.
        """
        # A kernel waits only for kernels that it calls, so processes cannot deadlock, except if two kernel names have
        # the same lock byte. The operating system detects that deadlock and refuses the lock.
        file = None if self.folder is None else _lock_file(self.folder)
        place = zlib.crc32(self.py_func.__qualname__.encode())
        locked = False
        if file is not None:
            with contextlib.suppress(OSError):
                fcntl.lockf(file, fcntl.LOCK_EX, 1, place)
                locked = True
        try:
            yield
        finally:
            if file is not None and locked:
                fcntl.lockf(file, fcntl.LOCK_UN, 1, place)


class OldKernel(Kernel):
    """
    Kernel for numba before 0.61, which compares named tuples by uninitialised memory (numba issue 9097).

    With numba's own lookup each call would leak some hundred bytes and could pick the code of another type. This class
    therefore looks up the machine code of calls with named tuples itself.
    """

    @functools.cached_property
    def entries(self) -> dict[Any, Any]:
        """Machine code of the calls with named tuples, by the types of the arguments."""
        return {}

    def __call__(self, *args: Any, **keywords: Any) -> Any:
        """
        Call the machine code for the types of the arguments, compiled at the first call with these types.

        Calls with keywords, or without a tuple among the arguments, use numba's own lookup.
        """
        if keywords or not any(isinstance(arg, tuple) for arg in args):
            return super().__call__(*args, **keywords)
        kinds = tuple(map(_kind, args))
        entry = self.entries.get(kinds)
        if entry is None:
            entry = self.entries[kinds] = self.compile(tuple(map(self.typeof_pyval, args)))
        return entry(*args)


def compiled(function: F) -> F:
    """
    Compile an explicit-loop kernel to machine code.

    The function must use scalars, numpy arrays and loops only (no Python objects, no ``@``: for small arrays loops are
    faster than matrix products). The machine code is cached next to the module. It is rebuilt when the module changes,
    or a module of this project from which it imports names. Floating point stays strict (no fast-math), so that a block
    of samples gives the same bits as the same samples one by one. The kernel releases the interpreter lock; other
    threads must not change the arrays of a call until it returns.
    """
    kernel: F = _kernel(function, False)
    return kernel


def specialised(function: F) -> F:
    """
    Compile a kernel like `compiled`, but separately for each kernel that calls it, and for each constant in the call.

    Use it for loops over the matrices of a record: LLVM turns them into vector instructions only if it knows the shape
    of the array and the number of iterations. The shape is known in code that names `record.matrix` itself, the number
    if it is a constant.
    """
    kernel: F = _kernel(function, True)
    return kernel


def _kernel(function: Any, specialised: bool) -> Any:
    # numba names its cache folder after the path of the source file. With the real path, an installation by symbolic
    # links shares the cached machine code of the original files.
    code = function.__code__
    function.__code__ = code.replace(co_filename=os.path.realpath(code.co_filename))
    options = {"nopython": True, "nogil": True, "fastmath": False}
    if numba.version_info.short >= (0, 61):
        kernel: Any = Kernel(function, targetoptions={**options, "forceinline": specialised})
        kernel.specialised = specialised
    else:
        # Older versions cannot force a kernel into its callers: the results are the same, the loops slower.
        kernel = OldKernel(function, targetoptions=options)
    kernel.enable_caching()
    return kernel


@contextlib.contextmanager
def when_compiling(report: Callable[[], None]) -> Iterator[None]:
    """Call `report` once within this context, before the first compilation of a kernel that is not in the cache."""
    waiting = [report]

    class First(event.Listener):  # type: ignore[misc]
        def on_start(self, _: object) -> None:
            if waiting:
                waiting.pop()()

        def on_end(self, _: object) -> None:
            """Ignore the end of a compilation."""

    with event.install_listener("numba:compile", First()):
        yield


@functools.cache
def _cache_folder(module: str) -> Path | None:
    """
    Return the cache folder for the machine code of a module's kernels, and remove outdated cache folders.

    The cache folder is below NUMBA_CACHE_DIR if set, else next to the module, else in the user's cache; None if all of
    these are read-only. Several installations may share one of these folders, so the name contains a hash of the
    module's path. Outdated folders are those of former versions of this installation, and those of other installations
    that no process has used for `_UNUSED_S`.
    """
    stamp = hashlib.sha256(repr(_stamps(module)).encode()).hexdigest()[:16]
    source = Path(getattr(sys.modules[module], "__file__", None) or "none.py").resolve()
    own = f"{module}-{hashlib.sha256(str(source).encode()).hexdigest()[:8]}-"
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    given = numba.config.CACHE_DIR
    for place in [Path(given)] if given else [source.parent / "__pycache__", user / "mwd"]:
        folder = place / f"{own}{stamp}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            # Set the modification time, which `_is_unused` reads as the time of last use.
            os.utime(folder)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            for other in place.glob(f"{module}-*"):
                if other != folder and (other.name.startswith(own) or _is_unused(other)):
                    shutil.rmtree(other, ignore_errors=True)
            return folder
    return None


def _is_unused(folder: Path) -> bool:
    """Return whether no process has used a folder for `_UNUSED_S`; False if the folder no longer exists."""
    try:
        return time.time() - folder.stat().st_mtime > _UNUSED_S
    except OSError:
        return False


@functools.cache
def _lock_file(folder: Path) -> int | None:
    """
    Open the lock file of a cache folder and return its descriptor; None if the file cannot be opened.

    A process locks one byte of the file for each kernel that it compiles.
    """
    try:
        # Never close the file: a process that closes a file loses all its locks on that file.
        return os.open(folder / "compiling.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError:
        return None


@functools.cache
def _stamps(name: str) -> tuple[tuple[str, int, int], ...]:
    """
    Return the names, modification times and file sizes of a module and of the project's modules that it uses.

    Each element has the name, the time, ns, and the size, bytes, of one module.
    """
    seen: set[str] = set()
    waiting = [name]
    while waiting:
        at = waiting.pop()
        module = sys.modules.get(at)
        if module is None or at in seen:
            continue
        seen.add(at)
        if hasattr(module, "__path__"):
            # Skip the names in a package: they are the modules imported so far, which differ between processes.
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
    """Return the properties of an argument that determine the numba type of the argument."""
    if isinstance(arg, tuple):
        return type(arg), *map(_kind, arg)
    if isinstance(arg, np.ndarray | np.void):
        return type(arg), arg.dtype, arg.ndim, arg.flags.num
    return type(arg)
