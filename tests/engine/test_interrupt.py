# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C while the main thread cannot act on it, and while it can."""

import ctypes
import os
import signal
import threading
import time
from pathlib import Path

import pytest

from patchnet.patchnet_addon import interrupt
from patchnet.patchnet_addon.interrupt import prompt_interrupt
from patchnet.patchnet_addon.unfinished import remove_unfinished, unfinished

pytestmark = pytest.mark.usefixtures("ctrl_c")


@pytest.fixture(autouse=True)
def short_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interrupt, "DEADLINE_S", 0.2)


def test_a_deaf_main_thread_is_ended() -> None:
    ended = threading.Event()
    with pytest.raises(KeyboardInterrupt), prompt_interrupt(ended.set):
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            assert ended.wait(30.0), "the block went on, as a call into Blender would"


def test_a_main_thread_that_acts_is_left_alone() -> None:
    ended = threading.Event()
    before = signal.set_wakeup_fd(-1)
    with pytest.raises(KeyboardInterrupt), prompt_interrupt(ended.set):
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
            with pytest.raises(KeyboardInterrupt), prompt_interrupt(lambda: None):
                signal.raise_signal(signal.SIGINT)
                time.sleep(1.0)
        assert calls == []
        signal.raise_signal(signal.SIGINT)
        assert calls == [signal.SIGINT], "it is there again"
    finally:
        assert c_signal(signal.SIGINT, pythons) == address


def test_other_handlers_are_left_alone() -> None:
    heard: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: heard.append(number))
    try:
        ended = threading.Event()
        with prompt_interrupt(ended.set):
            signal.raise_signal(signal.SIGINT)
            assert not ended.wait(0.5)
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [signal.SIGINT]


def test_what_is_not_finished_goes(tmp_path: Path) -> None:
    file, folder, done = tmp_path / "file", tmp_path / "folder", tmp_path / "done"
    (folder / "inside").mkdir(parents=True)
    for path in (file, done):
        path.write_text("text")
    with unfinished(done):
        pass
    with unfinished(file), unfinished(folder), unfinished(tmp_path / "never made"):
        remove_unfinished()
    assert [path.name for path in tmp_path.iterdir()] == ["done"]
