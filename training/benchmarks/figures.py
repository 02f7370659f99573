# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures of benchmarks: checked before anything long is measured, drawn alike, and written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from ...patchnet_addon.runtime.file_kinds import PDF, PNG, SVG
from ...patchnet_addon.runtime.outputs import check_outputs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KINDS = {".png": PNG, ".svg": SVG, ".pdf": PDF}
# Told apart also without colour vision (Okabe and Ito).
BLUE, ORANGE, GREEN, PURPLE, GRAY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "0.45"


def check_figure(path: Path, inputs: Iterable[Path]) -> None:
    """Raise PatchNetError if a figure could not be drawn to `path`, before anything long is measured.

    inputs: files that are read, and never replaced.
    """
    kind = _KINDS.get(path.suffix.lower())
    if kind is None:
        raise SettingError(f"Figure {path} has an unknown extension: choose one of {', '.join(_KINDS)} for --plot")
    if not path.absolute().parent.is_dir():
        raise SettingError(f"Figure {path} cannot be written: its folder does not exist; make it or change --plot")
    check_outputs({path: kind}, inputs)
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as cause:
        raise PatchNetError(
            f"Figure {path} cannot be drawn ({cause}): install patchnet-blender[bench], or leave out --plot"
        ) from cause


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; raises PatchNetError if it cannot be written."""
    beside = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")
    try:
        figure.savefig(beside)
        os.replace(beside, path)
    except OSError as cause:
        raise PatchNetError(
            f"{path} cannot be written: {cause.strerror or cause}; choose another folder or make room"
        ) from cause
    finally:
        beside.unlink(missing_ok=True)


def finish(axes: Axes) -> None:
    """Grid, frame and legend of a diagram."""
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=9, frameon=False, loc="best")
