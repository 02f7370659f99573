# SPDX-License-Identifier: GPL-3.0-or-later
"""Compile kernels in another process, before the first job of a window or beside a job."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import IO

import pytest

import patchnet
from patchnet.operators.jobs import compile_ahead as ahead
from patchnet.operators.jobs.compile_ahead import compiled_ahead
from patchnet.operators.pipeline import kernels_beside
from patchnet.patchnet_addon.runtime import kernels
from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.patchnet_addon.runtime.progress import drain


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
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


@pytest.fixture
def second(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A process that sleeps in the place of the second Python; the mark, and what was started."""
    started = SimpleNamespace(mark=tmp_path / "pictures", processes=[])

    def start() -> subprocess.Popen[bytes]:
        started.processes.append(subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]))
        return started.processes[-1]

    monkeypatch.setattr(kernels, "compiled_mark", lambda *_: started.mark)
    monkeypatch.setattr(kernels_beside, "start_second_python", start)
    monkeypatch.setattr(kernels_beside, "usable_cores", lambda: 2)
    return started


def test_beside_a_job_once_on_a_machine(second: SimpleNamespace) -> None:
    for _ in range(2):
        with kernels_beside.compiling_beside():
            assert [process.poll() for process in second.processes[1:]] == []
    assert len(second.processes) == 1 and second.processes[0].poll() is not None and second.mark.exists()


def test_beside_a_job_that_calls_none_of_them(second: SimpleNamespace) -> None:
    with kernels_beside.compiling_beside(calls_them=False):
        pass
    assert second.processes[0].poll() is not None and not second.mark.exists(), "it was not done"
    with kernels_beside.compiling_beside(calls_them=False):
        second.processes[1].kill()
        second.processes[1].wait()
    assert not second.mark.exists(), "it failed"
    with pytest.raises(SceneError), kernels_beside.compiling_beside():
        raise SceneError("nothing to see")
    assert not second.mark.exists() and all(process.poll() is not None for process in second.processes)


def test_the_second_python_calls_the_kernels() -> None:
    words = [sys.executable, kernels_beside.SCRIPT, "patchnet", Path(patchnet.__file__).parent, *sys.path]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr
