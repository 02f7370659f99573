# SPDX-License-Identifier: GPL-3.0-or-later
"""Log of a training run: curves and validations as JSON lines, and optionally for TensorBoard."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch

from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.replace import replaced_file
from ..file_kinds import TRAINING_LOG
from .run_files import log_lines

BOARD = "tensorboard"  # folder beside the log


class Log:
    """Curves as JSON lines."""

    def __init__(self, path: Path, steps: int, *, board: bool = False) -> None:
        """Continue the log of a run after `steps`; later lines of an interrupted run are dropped.

        board: also write TensorBoard's files beside it. Raises SettingError without TensorBoard, and as `log_lines` and
        `replaced_file`.
        """
        lines = log_lines(path) if steps and path.is_file() else []
        kept = [json.dumps(line) + "\n" for line in lines if line["step"] <= steps]
        with replaced_file(path, TRAINING_LOG) as file:
            file.write("".join(kept).encode())
        self._path = path
        self._board = _open_board(path.parent / BOARD, steps) if board else None
        self._losses: list[torch.Tensor] = []

    def add(self, losses: torch.Tensor) -> None:
        """Store the loss or errors of one step without synchronization with a GPU."""
        self._losses.append(losses)

    def means(self) -> list[float]:
        """Means of the values stored since the last call."""
        found: list[float] = torch.stack(self._losses).double().mean(0).flatten().tolist()
        self._losses.clear()
        return found

    def write_means(self, step: int, passes: int, rate: float, seconds: float) -> None:
        """Write the mean errors of coverage and luminance since the last call."""
        coverage, luminance = self.means()
        errors = {"coverage": round(coverage, 6), "luminance": round(luminance, 6)}
        self.write({"step": step, "passes": passes, "seconds": round(seconds, 1), "rate": rate} | errors)

    def write(self, entry: dict[str, Any]) -> None:
        """Append one line."""
        with self._path.open("a") as file:
            file.write(json.dumps(entry) + "\n")
        if self._board is not None:
            for name, value in _scalars(entry).items():
                self._board.add_scalar(name, value, entry["step"])
            self._board.flush()


def _open_board(folder: Path, steps: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as cause:
        raise SettingError("--tensorboard needs TensorBoard: install it with `pip install tensorboard`") from cause
    return SummaryWriter(str(folder), purge_step=steps + 1)  # type: ignore[no-untyped-call]


def _scalars(entry: dict[str, Any]) -> dict[str, float]:
    """Numbers of a line by TensorBoard tag: training/coverage, validation/courtyard/coverage."""
    found = {f"training/{name}": entry[name] for name in ("coverage", "luminance", "loss", "rate") if name in entry}
    for scene, errors in entry.get("validation", {}).items() if isinstance(entry.get("validation"), dict) else ():
        if isinstance(errors, dict):
            found |= {f"validation/{scene}/{name}": value for name, value in errors.items() if value is not None}
    return found
