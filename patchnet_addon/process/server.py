# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls in the engine process, each over a connection of its own.

Nobody else than Blender's process can call: the address lies in a private folder, and each caller proves that it knows
a key. Here threads are allowed: one reads a connection and sees that the caller stops, another computes. A call that
its caller has left ends after its present step.
"""

from __future__ import annotations

import threading
import time
import traceback
from contextlib import suppress
from dataclasses import replace
from multiprocessing import AuthenticationError
from multiprocessing.connection import Connection, Listener
from types import GeneratorType
from typing import Any

from ..runtime.compiling import NOTE, is_compiling
from ..runtime.progress import Progress
from .transfer import ERROR, REPORT, RESULT, EngineExchange, called

_REPORT_S = 0.01  # least time between two reports
_COMPILING_S = 0.1  # between two reports of a kernel that compiles
_LAST_S = 60.0  # for calls that must be finished after Blender's end


class Engine:
    """Calls of Blender's process."""

    def __init__(self) -> None:
        self._exchange = EngineExchange()
        self._calls: list[Call] = []

    def accept(self, listener: Listener) -> None:
        """Accept connections, each with threads of its own."""
        while True:
            with suppress(OSError, EOFError, AuthenticationError):  # the caller is gone already, or none of ours
                threading.Thread(target=self._serve, args=(listener.accept(),), daemon=True).start()

    def finish(self) -> None:
        """Wait for calls that must be finished."""
        deadline = time.monotonic() + _LAST_S
        for call in self._calls:
            if call.lasts:
                call.join(max(0.0, deadline - time.monotonic()))

    def _serve(self, connection: Connection) -> None:
        with connection, suppress(OSError, EOFError):
            call = Call(connection, self._exchange, connection.recv_bytes())
            self._calls = [each for each in self._calls if each.is_alive()] + [call]
            call.start()
            call.watch()
            call.join()


class Call(threading.Thread):
    """Call of one function. lasts: it is finished even if its caller has gone."""

    def __init__(self, connection: Connection, exchange: EngineExchange, data: bytes) -> None:
        super().__init__(daemon=True)
        self.lasts = self._stopped = False
        self._connection, self._exchange, self._data = connection, exchange, data
        self._sending = threading.Lock()
        self._report: Progress | None = None
        self._sent: list[Any] = []  # what the caller may not have read
        self._sent_at = 0.0

    def watch(self) -> None:
        """Look until the caller closes the connection, and report that kernels compile."""
        while not self._connection.poll(_COMPILING_S):
            if self._report is not None and is_compiling() and self.is_alive():
                self._send(REPORT, replace(self._report, note=NOTE, partial=None))
        self._stopped = True

    def run(self) -> None:
        """Compute, and send reports and the result, or the error."""
        try:
            gone, self.lasts, function, arguments = self._exchange.unpacked(self._data)
            self._exchange.drop(gone)
            result = called(function, arguments)
            if isinstance(result, GeneratorType):
                result = self._run_steps(result)
            self._send(RESULT, result)
        except BaseException as error:  # noqa: BLE001 - the caller raises it
            self._fail(error)

    def _run_steps(self, steps: GeneratorType[Any, None, Any]) -> Any:
        try:
            while self.lasts or not self._stopped:
                self._report = report = next(steps)
                if report.partial is not None or time.monotonic() - self._sent_at > _REPORT_S:
                    self._send(REPORT, report)
        except StopIteration as stop:
            return stop.value
        finally:
            steps.close()
        return None

    def _fail(self, error: BaseException) -> None:
        text = "".join(traceback.format_exception(error))
        try:
            self._send(ERROR, (error, text))
        except Exception:  # noqa: BLE001 - an error that cannot be pickled
            self._send(ERROR, (RuntimeError(repr(error)), text))

    def _send(self, kind: str, content: Any) -> None:
        if self._stopped:
            return
        packed = self._exchange.packed((kind, content))
        with self._sending, suppress(OSError):
            self._sent.append(packed.held)
            self._connection.send_bytes(packed.data)
            self._sent_at = time.monotonic()
