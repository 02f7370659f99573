# SPDX-License-Identifier: GPL-3.0-or-later
"""Compilation of numba kernels: one cache folder, one launch at a time.

Two facts shape this file. Parallel kernels launched from two threads at once abort the process under numba's
`workqueue` layer, so every parallel launch takes one lock. And numba's cache does not notice an edited callee in
another file, so the cache folder's name holds a hash of all kernel sources.
"""

from __future__ import annotations

import functools
import hashlib
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import event

from .compiling import compilation_begins, compilation_ends

Function = TypeVar("Function", bound=Callable[..., Any])

_LAUNCH_LOCK = threading.RLock()


def user_cache_folder() -> Path:
    """Folder for what can be computed again: `PATCHNET_CACHE`, or the platform's cache folder."""
    if folder := os.environ.get("PATCHNET_CACHE"):
        return Path(folder)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "patchnet"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "patchnet"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "patchnet"


def _sources_hash() -> str:
    digest = hashlib.sha256()
    engine = Path(__file__).parent
    folders = (engine, engine.parent / "training")
    for path in sorted(path for folder in folders for path in folder.rglob("*.py")):
        text = path.read_bytes()
        if b"kernels import" in text:
            digest.update(text)
    return digest.hexdigest()[:16]


numba.config.CACHE_DIR = str(user_cache_folder() / "kernels" / _sources_hash())


class _Compilations(event.Listener):  # type: ignore[misc]
    """Hears of each kernel that is compiled because the cache does not have it."""

    def on_start(self, _event: event.Event) -> None:
        compilation_begins()

    def on_end(self, _event: event.Event) -> None:
        compilation_ends()


event.register("numba:compile", _Compilations())


def device(function: Function) -> Function:
    """A function that kernels call; inlined by the compiler, never launched by itself."""
    return numba.njit(function, cache=True, nogil=True, error_model="numpy")


def kernel(function: Function) -> Function:
    """A function over arrays, compiled for all cores at its first call; launches are serialised."""
    return _serialised(function, numba.njit(function, cache=True, nogil=True, parallel=True, error_model="numpy"))


def serial_kernel(function: Function) -> Function:
    """Like `kernel`, for work that one core does in order; may be launched from several threads at once."""
    return numba.njit(function, cache=True, nogil=True, error_model="numpy")


def _serialised(function: Function, compiled: Any) -> Function:
    @functools.wraps(function)
    def launch(*arguments: Any) -> Any:
        with _LAUNCH_LOCK:
            return compiled(*arguments)

    return launch  # type: ignore[return-value]
