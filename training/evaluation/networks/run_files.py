# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of a map network's training run, and whether they can be written; imports no torch."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ....patchnet_addon.runtime.file_kinds import CHECKPOINT as CHECKPOINT_KIND
from ....patchnet_addon.runtime.file_kinds import TRAINING_LOG, arrays_kind
from ...run.run_files import CHECKPOINT, LOG, check_run
from .map_file import KIND

MAP = "sampling_map.safetensors"
FRAMES = "frames"  # folder of rendered frames
_KINDS = {CHECKPOINT: CHECKPOINT_KIND, LOG: TRAINING_LOG, MAP: arrays_kind(KIND)}


def check_map_run(out: Path, inputs: Iterable[Path] = (), *, resume: bool) -> None:
    """Check that a run can begin in `out`, or go on there; raises as `check_run`."""
    check_run(out, inputs, resume=resume, kinds=_KINDS)
