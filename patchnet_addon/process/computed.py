# SPDX-License-Identifier: GPL-3.0-or-later
"""Computations of the engine: in the engine process where Blender uses one, else in this process.

Blender uses one from registration on (`use_engine_process`). The command line, whose process is no user's window,
computes by itself. So does Blender where the system does not let it start the process, then without threads.
"""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable
from contextlib import suppress
from types import GeneratorType
from typing import Any

from ..runtime.errors import EngineGoneError
from ..runtime.progress import Progress, Steps, drain
from .transfer import called

_WORKING = Progress(0, 1, "Working")
_STEP_S = 1.0  # longest usual step
_SENT = 2  # reports, the first one before a call is sent


class _Engine:
    """Whether Blender uses a process, the running one, and why it cannot be started."""

    is_used = False
    process: Any = None
    refused = ""


def use_engine_process() -> None:
    """Compute in an engine process from now on; it is started at the first call."""
    _Engine.is_used = True


def end_engine_process() -> None:
    """Let the process end, which frees its memory; the next call starts a new one."""
    process, _Engine.process = _Engine.process, None
    if process is not None:
        process.leave()


def leave_engine_process() -> None:
    """Let the process end, and compute in this one from now on."""
    end_engine_process()
    _Engine.is_used, _Engine.refused = False, ""


def settle() -> None:
    """Return when no stopped call computes any longer, after a tenth of a second at most."""
    if _Engine.process is not None:
        _Engine.process.settle()


def wait_for_step() -> None:
    """Return when no stopped call writes to shared memory any longer, after a second at most."""
    if _Engine.process is not None:
        _Engine.process.has_settled(_STEP_S)


def release() -> None:
    """Let the engine drop what is gone here, which it otherwise does at its next call."""
    process = _Engine.process
    if process is not None and process.is_alive and process.exchange.gone:
        steps = computed(gc.collect)
        with suppress(EngineGoneError):
            for _ in range(_SENT):
                next(steps)
        steps.close()


def engine_pid() -> int | None:
    """Process number of the engine, None if there is none."""
    process = _Engine.process
    return process.pid if process is not None and process.is_alive else None


def refused() -> str:
    """Sentence why there is no engine process although it is wanted, or ""."""
    return _Engine.refused


def computed(function: Callable[..., Any], *arguments: Any, at: Progress = _WORKING, lasts: bool = False) -> Steps[Any]:
    """Return function(*arguments), or the result of its steps.

    function: of a module that does not import Blender, since the engine process imports it. arguments, result: what
    can be pickled; arrays lie in memory that both processes share, also while the function writes to them. Remotes are
    passed on as their values. at: report until the steps yield their first. lasts: the function is finished even if
    nobody pulls these steps any longer. Raises the errors of the function, and EngineGoneError.
    """
    yield at
    process = _started()
    if process is not None:
        from .client import EngineRefusedError

        try:
            return (yield from process.call(function, arguments, at, lasts=lasts))
        except EngineRefusedError as cause:
            _refuse(cause)
    result = called(function, arguments)
    return (yield from result) if isinstance(result, GeneratorType) else result


def answer(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return function(*arguments) at once, see `computed`."""
    return drain(computed(function, *arguments))


def _started() -> Any:
    """Running process, or None to compute here."""
    if not _Engine.is_used or _Engine.refused:
        return None
    before = _Engine.process
    if before is None or not before.is_alive:
        from .client import EngineProcess, EngineRefusedError

        try:
            process = EngineProcess()
        except EngineRefusedError as cause:
            _refuse(cause)
            return None
        if _Engine.process is before:
            _Engine.process = process
        else:  # a render in a thread of Blender has started one meanwhile
            process.leave()
    return _Engine.process


def _refuse(cause: Exception) -> None:
    from ..runtime.threads import use_no_threads
    from .own_wheels import other_versions_text

    _Engine.process = None
    _Engine.refused = (
        f"PatchNet cannot start its engine process ({cause}): allow Blender to start its own Python in the security "
        "software; until then PatchNet computes within Blender, which is slower and halts the window"
    )
    if others := other_versions_text(computes_with_own=False):
        _Engine.refused += f". {others}"
    use_no_threads()
    logging.getLogger("patchnet").warning(_Engine.refused)
