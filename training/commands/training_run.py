# SPDX-License-Identifier: GPL-3.0-or-later
"""Arguments and preparation of a training run with torch: device, threads, checkpoints, resuming."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable
from pathlib import Path

from ...commands.shared.arguments import add_device, add_number
from ...patchnet_addon.runtime.errors import SettingError
from .. import bounds


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --device, --threads, --resume and --stop-after."""
    add_device(parser, "device for training; auto: a GPU if torch has one (auto)")
    text = "threads of the CPU that train, or gather batches for a GPU (all cores)"
    add_number(parser, "--threads", bounds.THREADS, text)
    parser.add_argument(
        "--resume", action="store_true", help="continue the run in --out, also with more passes or steps"
    )
    text = "end early, leaving a checkpoint to resume from"
    add_number(parser, "--stop-after", bounds.STOP_AFTER, text, metavar="STEPS")


def require_torch() -> None:
    """Import torch with passive waiting threads; raises SettingError with the command to install it."""
    # Spinning threads slow down a shared machine; must be set before torch is imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    try:
        import torch  # noqa: F401
    except ImportError as cause:
        raise SettingError("Training needs torch: install it with `pip install 'patchnet-blender[train]'`") from cause


def say_written(out: Path, names: Iterable[str]) -> None:
    """Print the files of a run in its folder."""
    print(f"{out} holds {', '.join(name for name in names if (out / name).exists())}")
