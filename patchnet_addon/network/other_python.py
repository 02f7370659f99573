# SPDX-License-Identifier: GPL-3.0-or-later
"""Encode in another Python that has torch, as a process that is fed chunk by chunk."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ..runtime.errors import SettingError
from .array_stream import read_array, write_array
from .weights import Weights

_WORKER = Path(__file__).with_name("torch_worker.py")
_ASK = (
    "import json, sys, torch; print(json.dumps([torch.__version__, torch.cuda.is_available(), sys.version.split()[0]]))"
)
# What Blender sets for its own Python would mislead another one.
_BLENDERS_OWN = ("PYTHONHOME", "PYTHONPATH", "PYTHONSTARTUP")


def ask_python(python: Path, seconds: float = 60.0) -> str:
    """Ask a Python for its torch, in a few words; raises SettingError that says what is wrong with it."""
    try:
        done = subprocess.run(
            [str(python), "-c", _ASK], capture_output=True, text=True, timeout=seconds, env=environment(), check=False
        )
    except (OSError, subprocess.TimeoutExpired) as cause:
        raise SettingError(f"{python} cannot be run as a Python ({cause}): choose the program of a Python") from cause
    try:
        torch, has_gpu, version = json.loads(done.stdout.splitlines()[-1])
    except (ValueError, IndexError) as cause:
        raise SettingError(
            f"{python} has no torch ({_last_line(done.stderr)}): install it there, or choose another"
        ) from cause
    return f"torch {torch}{' with a GPU' if has_gpu else ', no GPU'}, Python {version}"


def environment() -> dict[str, str]:
    """This process's environment as another Python may see it."""
    return {name: value for name, value in os.environ.items() if name not in _BLENDERS_OWN}


class OtherPythonEncoder:
    """`Encoder` whose work another process does, and a context manager around that process."""

    def __init__(self, python: Path, weights: Weights, device: str = "auto") -> None:
        """Start on `device`, auto, cpu or cuda; raises SettingError if the Python cannot be run or has no torch."""
        self._python = python
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - a pipe without a reader would fill up
        try:
            self._process = subprocess.Popen(
                [str(python), str(_WORKER), device],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, env=environment(),
            )  # fmt: skip
        except OSError as cause:
            self._errors.close()
            raise SettingError(f"{python} cannot be run ({cause.strerror}): choose the program of a Python") from cause
        try:
            layers = [array for layer in weights.encoder for array in layer]
            self._send(np.array(len(weights.encoder)), *layers)
            self.said: dict[str, Any] = json.loads(self._answers.readline())
        except (OSError, ValueError) as cause:
            raise self._failed() from cause
        self.chunk = int(self.said["chunk"])

    def __call__(self, blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Codes (C, 10) float32, see `Encoder`; raises SettingError if the process has ended."""
        try:
            self._send(blocks, rows)
            return read_array(self._answers)
        except (OSError, ValueError, EOFError) as cause:
            raise self._failed() from cause

    def __enter__(self) -> OtherPythonEncoder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            if stream is not None:
                with suppress(OSError):  # what was not sent yet
                    stream.close()

    @property
    def _answers(self):  # type: ignore[no-untyped-def]
        return self._process.stdout

    def _send(self, *arrays: np.ndarray) -> None:
        stream = self._process.stdin
        assert stream is not None
        for array in arrays:
            write_array(stream, array)  # type: ignore[arg-type]
        stream.flush()

    def _failed(self) -> SettingError:
        """Error to raise when the process does not answer; it is ended."""
        if self._process.poll() is None:
            try:
                self._process.wait(1.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._errors.seek(0)
        reason = _last_line(self._errors.read().decode(errors="replace"))
        self.close()
        return SettingError(f"{self._python} cannot encode ({reason}): install torch there, or choose another Python")


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1] if lines else "it said nothing"
