# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of a training run, and whether they can be written; imports no torch."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ...patchnet_addon.runtime.errors import FileFormatError, SettingError
from ...patchnet_addon.runtime.file_kinds import CHECKPOINT as CHECKPOINT_KIND
from ...patchnet_addon.runtime.file_kinds import MODEL_CARD, PNG, TRAINING_LOG, FileKind
from ...patchnet_addon.runtime.file_kinds import WEIGHTS as WEIGHTS_KIND
from ...patchnet_addon.runtime.outputs import check_outputs

CHECKPOINT = "checkpoint.pt"
LOG = "log.jsonl"
WEIGHTS = "patchnet.safetensors"
CARD = "model_card.md"
CURVES = "curves.png"
RUN_FILES = {
    WEIGHTS: WEIGHTS_KIND, CARD: MODEL_CARD, CURVES: PNG, LOG: TRAINING_LOG, CHECKPOINT: CHECKPOINT_KIND
}  # fmt: skip


def log_lines(path: Path) -> list[dict[str, Any]]:
    """Lines of a run's log; a last one that was cut when the run was killed is left out.

    Raises FileFormatError for other lines that are none of a log.
    """
    lines = path.read_text(encoding="utf-8").splitlines()
    found = []
    for number, line in enumerate(lines, 1):
        try:
            entry = json.loads(line)
            entry["step"]
        except (ValueError, TypeError, KeyError) as cause:
            if number == len(lines):
                break
            raise FileFormatError(f"{path} is damaged in line {number}: move it away, or start the run anew") from cause
        found.append(entry)
    return found


def check_run(
    out: Path, inputs: Iterable[Path] = (), *, resume: bool, kinds: Mapping[str, FileKind] = RUN_FILES
) -> None:
    """Check that a run can begin in `out`, or go on there; kinds: of its files by name, the checkpoint among them.

    Raises OutputError for files that cannot be written or are to stay, SettingError if there is a run already, and
    FileFormatError if there is none to resume.
    """
    check_outputs({out / name: kind for name, kind in kinds.items()}, inputs, folder=out)
    there = (out / CHECKPOINT).exists()
    if resume and not there:
        raise FileFormatError(f"{out / CHECKPOINT} does not exist: start the run without --resume")
    if there and not resume:
        raise SettingError(f"{out} holds a run already: continue it with --resume or choose another folder")
