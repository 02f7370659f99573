# SPDX-License-Identifier: GPL-3.0-or-later
"""Compile kernels in another process, before the first job of a window."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import IO

import pytest

from patchnet.operators.jobs import compile_ahead as ahead
from patchnet.operators.jobs.compile_ahead import compiled_ahead
from patchnet.patchnet_addon.runtime.progress import drain


@pytest.fixture
def folder(registered: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of kernels, with none in it."""
    monkeypatch.setattr(ahead, "_mark", lambda: tmp_path / "all-kernels")
    return tmp_path


@pytest.fixture
def other(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], SimpleNamespace]:
    """Python code in the place of the other Blender; what was started."""

    def stand_in(code: str) -> SimpleNamespace:
        started = SimpleNamespace(processes=[])

        def start(said: IO[bytes]) -> subprocess.Popen[bytes]:
            started.processes.append(subprocess.Popen([sys.executable, "-c", code], stdout=said, stderr=said))
            return started.processes[-1]

        monkeypatch.setattr(ahead, "start_other_blender", start)
        return started

    return stand_in


def test_once_on_a_machine(folder: Path, other: Callable[[str], SimpleNamespace]) -> None:
    started = other("pass")
    for _ in range(2):
        drain(compiled_ahead())
    assert len(started.processes) == 1 and len(list(folder.glob("all-*"))) == 1


def test_a_failure_is_told_once_and_stops_nothing(
    folder: Path, other: Callable[[str], SimpleNamespace], caplog: pytest.LogCaptureFixture
) -> None:
    started = other("import sys; print('no module named numba'); sys.exit(1)")
    with caplog.at_level("WARNING", "patchnet"):
        for _ in range(2):
            drain(compiled_ahead())
    assert len(started.processes) == 1 and list(folder.glob("all-*")) == []
    assert caplog.text.count("no module named numba") == 1 and "exit code 1" in caplog.text


def test_stopping_ends_the_other_process(folder: Path, other: Callable[[str], SimpleNamespace]) -> None:
    started = other("import time; time.sleep(600)")
    steps = compiled_ahead()
    while not started.processes:
        next(steps)
    steps.close()
    assert started.processes[0].poll() is not None and list(folder.glob("all-*")) == []
    drained = other("pass")
    drain(compiled_ahead())
    assert len(drained.processes) == 1, "the next job goes on"
