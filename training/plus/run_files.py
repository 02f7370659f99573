# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of a training run of the error estimator, and checks of them; does not import torch."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ...patchnet_addon.runtime.file_kinds import TRAINING_LOG, arrays_kind
from ...patchnet_addon.runtime.file_kinds import WEIGHTS as WEIGHTS_KIND
from ...patchnet_addon.runtime.outputs import check_outputs
from ...patchnet_addon.sampling.plus.weights import KIND
from ..run.run_files import WEIGHTS

ESTIMATORS = "plus.safetensors"
LOG = "log.jsonl"
REFERENCES = "references"  # folder of references
RUN_FILES = {WEIGHTS: WEIGHTS_KIND, ESTIMATORS: arrays_kind(KIND), LOG: TRAINING_LOG}
"""The weights file contains PatchNet's weights and the estimator."""


def check_plus_run(out: Path, inputs: Iterable[Path] = ()) -> None:
    """Check that a run can write its files in `out`; raises OutputError."""
    check_outputs({out / name: kind for name, kind in RUN_FILES.items()}, inputs, folder=out)
