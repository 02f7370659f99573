# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of a training run, and checks of them; does not import torch."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ...patchnet_addon.runtime.errors import FileFormatError, SettingError
from ...patchnet_addon.runtime.file_kinds import FileKind
from ...patchnet_addon.runtime.outputs import check_outputs
from ..file_kinds import CHECKPOINT as CHECKPOINT_KIND
from ..file_kinds import TRAINING_LOG
from ..file_kinds import WEIGHTS as WEIGHTS_KIND

CHECKPOINT = "checkpoint.pt"
LOG = "log.jsonl"
WEIGHTS = "patchnet.safetensors"
RUN_FILES = {WEIGHTS: WEIGHTS_KIND, LOG: TRAINING_LOG, CHECKPOINT: CHECKPOINT_KIND}


def log_lines(path: Path) -> list[dict[str, Any]]:
    """Lines of a run's log but a truncated last one; raises FileFormatError for other invalid lines."""
    lines = path.read_text(encoding="utf-8").splitlines()
    found = []
    for number, line in enumerate(lines, 1):
        try:
            entry = json.loads(line)
            entry["step"]
        except (ValueError, TypeError, KeyError) as cause:
            if number == len(lines):
                break
            raise FileFormatError(f"{path} is damaged in line {number}: delete it, or start the run again") from cause
        found.append(entry)
    return found


def read_log(path: Path) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Lines of the training curve and of the validations in a log; raises as `log_lines`."""
    lines = log_lines(path)
    return [line for line in lines if "coverage" in line], [line for line in lines if "validation" in line]


def check_run(
    out: Path, inputs: Iterable[Path] = (), *, resume: bool, kinds: Mapping[str, FileKind] = RUN_FILES
) -> None:
    """Check that a run can start or resume in `out`; kinds: of its files by name, including the checkpoint.

    Raises OutputError for files that cannot be written or replaced, SettingError for an existing run, and
    FileFormatError if there is none to resume.
    """
    check_outputs({out / name: kind for name, kind in kinds.items()}, inputs, folder=out)
    there = (out / CHECKPOINT).exists()
    if resume and not there:
        raise FileFormatError(f"{out / CHECKPOINT} does not exist: start the run without --resume")
    if there and not resume:
        raise SettingError(f"{out} already contains a run: continue it with --resume or choose another folder")
