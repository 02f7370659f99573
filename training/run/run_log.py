# SPDX-License-Identifier: GPL-3.0-or-later
"""Log of a training run: curves and validations as JSON lines."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch

from ...patchnet_addon.runtime.replace import replaced_file
from ..file_kinds import TRAINING_LOG
from .run_files import log_lines


class Log:
    """Curves as JSON lines."""

    def __init__(self, path: Path, steps: int) -> None:
        """Continue the log of a run after `steps`; later lines of an interrupted run are dropped.

        Raises errors of `log_lines` and `replaced_file`.
        """
        lines = log_lines(path) if steps and path.is_file() else []
        kept = [json.dumps(line) + "\n" for line in lines if line["step"] <= steps]
        with replaced_file(path, TRAINING_LOG) as file:
            file.write("".join(kept).encode())
        self._path = path
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
