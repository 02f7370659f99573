# SPDX-License-Identifier: GPL-3.0-or-later
"""Compilation of numba kernels, and their cache folder.

numba's cache does not notice changes of callees in other files, so the folder's name contains a hash of all sources of
kernels and their imports, and of the package's name, which compiled code contains: Blender imports it under another
name than Python. Copies of these sources under one name share it.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import logging
import pickle
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.registry import CPUDispatcher
from numba.core.types.misc import unliteral

from .cache_folder import kernel_folder, user_cache_folder
from .compiling import count_compilations
from .source_hash import ROOT, source_hash

Function = TypeVar("Function", bound=Callable[..., Any])


def _with_kernels() -> list[str]:
    """Modules that define kernels or extend numba; the extension does not contain training."""
    paths = [path for folder in ("patchnet_addon", "training") for path in (ROOT / folder).rglob("*.py")]
    texts = {path: path.read_bytes() for path in paths}
    found = [path for path, text in texts.items() if b"kernels import" in text or b"numba.extending import" in text]
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in found]


_VERSION = hashlib.sha256(f"{__package__} {source_hash(*_with_kernels())}".encode()).hexdigest()[:16]
numba.config.CACHE_DIR = str(kernel_folder(user_cache_folder(), _VERSION))


class CacheFile(IndexDataCacheFile):
    """Files of a function's compiled code, with names that no other process uses.

    numba numbers them. Two processes that compile a function for different types at the same time both take the next
    number, and later calls for one of these types would load the code of the other.
    """

    def _data_name(self, _number: int) -> str:
        return f"{Path(self._index_name).stem}.{uuid.uuid4().hex[:12]}.nbc"


class _Cache(FunctionCache):
    """numba's cache of a function's compiled code; unreadable or unwritable files only cost time."""

    def __init__(self, function: Function) -> None:
        super().__init__(function)
        locator = self._impl.locator
        stamp, source = locator.get_source_stamp(), Path(inspect.getfile(function))
        if source.is_relative_to(ROOT):  # versions are distinguished by the hash of all sources
            path = Path(numba.config.CACHE_DIR) / ".".join(source.relative_to(ROOT).parent.parts)
            stamp, locator.get_cache_path = "", lambda: str(path)
        self._cache_path = locator.get_cache_path()
        self._cache_file = CacheFile(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled code for a signature, or None."""
        try:
            return super().load_overload(sig, target_context)
        except (OSError, EOFError, pickle.UnpicklingError) as cause:
            _say_uncached(getattr(cause, "strerror", None) or type(cause).__name__)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write compiled code."""
        try:
            super().save_overload(sig, data)
        except OSError as cause:
            _say_uncached(cause.strerror or type(cause).__name__)


@functools.cache
def _say_uncached(reason: str) -> None:
    logging.getLogger("patchnet").warning(
        "Compiled kernels cannot be kept in %s (%s): they are compiled again at the next start; make room, or name "
        "another folder in the preferences or in PATCHNET_CACHE",
        numba.config.CACHE_DIR, reason,
    )  # fmt: skip


class _Compilations(event.Listener):
    """Listener to compilations of functions that are not in the cache."""

    def on_start(self, _event: event.Event) -> None:
        count_compilations(1)

    def on_end(self, _event: event.Event) -> None:
        count_compilations(-1)


event.register("numba:compile", _Compilations())


def device(function: Function) -> Function:
    """Decorate a function that creates no arrays, for calls from kernels only; the compiler inlines it.

    A wrapper for calls from Python would take longer to compile than most of these functions. Its arguments' references
    are not counted: each count is an atomic instruction, which dominates the time of a short function with many arrays.
    """
    return _for_kernels(_compiled(function, no_cpython_wrapper=True, _nrt=False))


def array_device(function: Function) -> Function:
    """Decorate a function as `device` that creates arrays, or calls one that does."""
    return _for_kernels(_compiled(function, no_cpython_wrapper=True))


def kernel(function: Function) -> Function:
    """Compile a function over arrays at its first call; it runs without the interpreter's lock, in any thread.

    For all cores, see `run_parts` of threads.py.
    """
    return _compiled(function)


def _compiled(function: Function, **options: bool) -> Any:
    options = {"no_cfunc_wrapper": True} | options  # no calls from C
    compiled = numba.njit(function, nogil=True, error_model="numpy", **options)
    compiled.get_call_template = functools.partial(_plain_call, compiled)
    with contextlib.suppress(RuntimeError):  # no folder is writable
        compiled._cache = _Cache(function)  # as cache=True, but tolerates errors of files
    return compiled


class _DeviceFunction(CPUDispatcher):
    """Function that only kernels can call."""

    def __call__(self, *_arguments: Any) -> Any:
        """Refuse; without this, Python would jump to what was never compiled."""
        raise TypeError(f"{self.__name__} is a device function: call it from a kernel, or its py_func from Python")


def _for_kernels(compiled: Any) -> Any:
    compiled.__class__ = _DeviceFunction
    return compiled


def _plain_call(compiled: Any, arguments: Any, keywords: Any) -> Any:
    """Type a call of a device function by its arguments' types alone.

    numba would otherwise compile a function again for each constant argument. The compiler still propagates constants
    when it inlines.
    """
    plain = {name: unliteral(kind) for name, kind in dict(keywords).items()}
    return type(compiled).get_call_template(compiled, tuple(unliteral(kind) for kind in arguments), plain)
