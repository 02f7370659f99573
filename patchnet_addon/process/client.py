# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine process as Blender's process sees it: start, calls, end.

It is started with Blender's own Python at the first call, and again after its end. It ends with Blender, since it reads
a pipe that the system closes then.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from multiprocessing.connection import Client, Connection
from pathlib import Path
from typing import Any

from ..runtime.cache_folder import user_cache_folder
from ..runtime.errors import EngineGoneError
from ..runtime.progress import Progress, Steps
from .own_wheels import other_versions_text
from .transfer import ERROR, REPORT, BlenderExchange

ROOT = Path(__file__).parents[2]
PACKAGE = __package__.removesuffix(".patchnet_addon.process")
_POLL_S = 0.004  # a window is drawn between two polls
_START_S, _UNPACKING_S = 60.0, 600.0  # until the first call is accepted; if it may unpack wheels
_STOP_S = 0.1  # for a step that is running


class EngineRefusedError(Exception):
    """The system does not let Blender start the engine process."""


class EngineProcess:
    """Running engine process. exchange: of objects that it has."""

    def __init__(self) -> None:
        """Start it; raises EngineRefusedError."""
        self.exchange = BlenderExchange()
        self._stopping: list[Connection] = []
        self._folder = tempfile.mkdtemp(prefix="patchnet-engine-")  # only this user can open it
        self._key, self._address = secrets.token_bytes(32), _address(self._folder)
        self._is_ready, self._begun_at = False, time.monotonic()
        self._others = other_versions_text(computes_with_own=True)
        flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # else a terminal opens on Windows
        command = [_python(), "-I", str(Path(__file__).with_name("start_engine.py"))]
        temporary = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), self._folder)  # goes with the process
        environment = os.environ | temporary | {"PATCHNET_CACHE": str(user_cache_folder())}
        try:
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, env=environment, creationflags=flags)
        except OSError as cause:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise EngineRefusedError(cause.strerror or str(cause)) from cause
        settings = {"package": PACKAGE, "folder": str(ROOT), "path": sys.path}
        settings |= {"address": self._address, "own_folder": self._folder, "key": self._key.hex()}
        assert self._process.stdin is not None
        self._input = self._process.stdin
        with suppress(OSError):
            self._input.write(json.dumps(settings).encode() + b"\n")
            self._input.flush()

    @property
    def is_alive(self) -> bool:
        """Return whether the process runs."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """Number of the process for the system."""
        return self._process.pid

    def call(
        self, function: Callable[..., Any], arguments: tuple[Any, ...], at: Progress, *, lasts: bool = False
    ) -> Steps[Any]:
        """Reports and result of function(*arguments); closing these steps stops it after its present step.

        lasts: it is finished even if its caller or Blender ends. Raises its errors, and EngineGoneError.
        """
        self._stopping = [each for each in self._stopping if not _has_ended(each, 0.0)]
        connection = yield from self._connected(at)
        is_done = False
        try:
            packed = self.exchange.packed((self.exchange.take_gone(), lasts, function, arguments))
            kind: str = REPORT
            content: Any = at
            with self._talking():
                connection.send_bytes(packed.data)
            while kind == REPORT:
                yield replace(content, waiting=True)
                with self._talking():
                    while not connection.poll(_POLL_S):
                        yield replace(content, waiting=True, partial=None)
                    kind, content = self.exchange.unpacked(connection.recv_bytes())
                self.exchange.sent.update(packed.numbers)  # only now the engine has them for sure
            is_done = True
        finally:
            if is_done:
                connection.close()
            else:
                self._stopping.append(connection)
                with suppress(OSError):
                    connection.send_bytes(b"stop")
        if kind == ERROR:
            error, text = content
            error.add_note(f"In the engine process:\n{text}")
            raise error
        return content

    def settle(self) -> None:
        """Wait for the present steps of stopped calls, and end the process if one takes long."""
        if not self.has_settled(_STOP_S):
            self.end()
        self._stopping = []

    def has_settled(self, seconds: float) -> bool:
        """Wait some seconds for the present steps of stopped calls; return whether all have ended."""
        deadline = time.monotonic() + seconds
        return all(_has_ended(each, max(0.0, deadline - time.monotonic())) for each in list(self._stopping))

    def end(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)

    def leave(self) -> None:
        """Let the process end by itself, once it has finished what must be."""
        with suppress(OSError):
            self._input.close()

    def _connected(self, at: Progress) -> Steps[Connection]:
        """New connection; waits while the process starts. Raises EngineGoneError, and EngineRefusedError at a start."""
        while True:
            try:
                connection = Client(self._address, authkey=self._key)
            except (OSError, EOFError) as cause:
                limit_s = _UNPACKING_S if self._others else _START_S
                if not self.is_alive or time.monotonic() - self._begun_at > limit_s:
                    error = self._gone() if self._is_ready else EngineRefusedError(self._why())
                    self.end()
                    raise error from cause
            else:
                self._is_ready = True
                _warn_once(self._others)
                return connection
            yield replace(at, waiting=True)
            time.sleep(_POLL_S)

    @contextmanager
    def _talking(self) -> Iterator[None]:
        """Raise EngineGoneError for an end of the process within the block."""
        try:
            yield
        except (OSError, EOFError) as cause:
            raise self._gone() from cause

    def _gone(self) -> EngineGoneError:
        return EngineGoneError(
            f"PatchNet's engine has ended ({self._why()}): run this again; what was finished is kept"
        )

    def _why(self) -> str:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        code = self._process.returncode
        return "no answer" if code is None else f"exit code {code}" if code >= 0 else f"signal {-code}"


@cache
def _warn_once(text: str) -> None:
    if text:
        logging.getLogger("patchnet").warning(text)


def _has_ended(connection: Connection, seconds: float) -> bool:
    """Wait up to some seconds for the end of a stopped call, and close its connection."""
    end = time.monotonic() + seconds
    with suppress(OSError, EOFError):
        while connection.poll(max(0.0, end - time.monotonic())):
            connection.recv_bytes()
        return False
    connection.close()
    return True


def _address(folder: str) -> str:
    """Address of the process: a socket in a folder, on Windows a pipe."""
    if os.name == "nt":
        return rf"\\.\pipe\patchnet-{os.getpid()}-{secrets.token_hex(8)}"
    return str(Path(folder) / "engine")


def _python() -> str:
    """Blender's own Python."""
    return sys.executable
