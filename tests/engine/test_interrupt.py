# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C and SIGTERM while the main thread is busy, and while it is not."""

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from patchnet.patchnet_addon.runtime import interrupt
from patchnet.patchnet_addon.runtime.interrupt import Interrupted, exit_code_of, interrupts_wait, prompt_interrupt
from patchnet.patchnet_addon.runtime.replace import goes_with_process, remove_unfinished, unfinished

pytestmark = pytest.mark.usefixtures("ctrl_c")


@pytest.fixture(autouse=True)
def short_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interrupt, "DEADLINE_S", 0.2)


both = pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.skipif(os.name == "nt", reason="Windows only ends processes")),
    ],
)

DEAF = """
import signal, sys, time
from pathlib import Path
from patchnet.patchnet_addon.runtime import interrupt
from patchnet.patchnet_addon.runtime.replace import unfinished

interrupt.DEADLINE_S = 0.1
path = Path(sys.argv[1])
path.write_text("half")
with unfinished(path), interrupt.prompt_interrupt():
    try:
        signal.raise_signal(int(sys.argv[2]))
    finally:
        time.sleep(60.0)
"""


@pytest.fixture(autouse=True)
def ended(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Set in place of the end of this process."""
    event = threading.Event()
    monkeypatch.setattr(interrupt, "end_process", lambda *_: event.set())
    return event


@both
def test_a_deaf_main_thread_is_ended(number: signal.Signals, ended: threading.Event) -> None:
    with pytest.raises(KeyboardInterrupt) as caught, prompt_interrupt():
        try:
            signal.raise_signal(number)
        finally:
            assert ended.wait(30.0), "the block went on, as a call into Blender would"
    assert exit_code_of(caught.value) == 128 + number


@both
@pytest.mark.parametrize("stderr", ["open", "closed"])
def test_the_process_ends_with_a_sentence_and_the_signals_code(
    number: signal.Signals, stderr: str, tmp_path: Path
) -> None:
    close = "import os; os.close(2)\n" if stderr == "closed" else ""
    command = [sys.executable, "-c", close + DEAF, str(tmp_path / "half"), str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 128 + number
    assert ("interrupted; start again to continue the bake" in done.stderr) == (stderr == "open")
    assert list(tmp_path.iterdir()) == []


@both
def test_a_call_into_blender_is_heard_out(number: signal.Signals) -> None:
    """Raised in what Blender calls, an interruption would be printed and lost."""
    went_on = []
    with pytest.raises(Interrupted) as caught, prompt_interrupt():
        with interrupts_wait():
            with interrupts_wait():
                signal.raise_signal(number)
                went_on.append("the inner call")
            went_on.append("the outer call")
        went_on.append("after it")
    assert went_on == ["the inner call", "the outer call"] and exit_code_of(caught.value) == 128 + number
    with prompt_interrupt(), interrupts_wait():
        pass  # nothing is left of it


def test_a_main_thread_that_acts_is_left_alone(ended: threading.Event) -> None:
    before = signal.set_wakeup_fd(-1)
    with pytest.raises(KeyboardInterrupt), prompt_interrupt():
        signal.raise_signal(signal.SIGINT)
    time.sleep(0.5)
    assert not ended.is_set()
    assert signal.set_wakeup_fd(before) == -1, "nobody listens any more"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no handler to take the place of")
def test_a_handler_that_is_not_pythons_is_put_back() -> None:
    """As Blender's in background: Python does not know of it, and Ctrl-C within the block is Python's."""
    c_signal = ctypes.CDLL(None).signal
    c_signal.restype, c_signal.argtypes = ctypes.c_void_p, (ctypes.c_int, ctypes.c_void_p)
    calls: list[int] = []
    host = ctypes.CFUNCTYPE(None, ctypes.c_int)(calls.append)
    address = ctypes.cast(host, ctypes.c_void_p).value
    pythons = c_signal(signal.SIGINT, address)
    try:
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt), prompt_interrupt():
                signal.raise_signal(signal.SIGINT)
                time.sleep(1.0)
        assert calls == []
        signal.raise_signal(signal.SIGINT)
        assert calls == [signal.SIGINT], "it is there again"
    finally:
        assert c_signal(signal.SIGINT, pythons) == address


@pytest.mark.skipif(os.name == "nt", reason="Windows has no processes that ignore a signal")
def test_an_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with pytest.raises(KeyboardInterrupt), prompt_interrupt():
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGINT)  # the other one is heard
    finally:
        signal.signal(signal.SIGTERM, before)


def test_what_is_not_finished_goes(tmp_path: Path) -> None:
    file, folder, done = tmp_path / "file", tmp_path / "folder", tmp_path / "done"
    (folder / "inside").mkdir(parents=True)
    goes_with_process(tmp_path / "session")
    (tmp_path / "session").mkdir()
    for path in (file, done):
        path.write_text("text")
    with unfinished(done):
        pass
    with unfinished(file), unfinished(folder), unfinished(tmp_path / "never made"):
        remove_unfinished()
    assert [path.name for path in tmp_path.iterdir()] == ["done"]
