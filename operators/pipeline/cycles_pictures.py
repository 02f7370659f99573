# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of a refinement by Cycles, for Blender's images and for files."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from ...patchnet_addon.image.background import opaque
from ...patchnet_addon.image.colormaps import colormap
from ...patchnet_addon.image.contact_sheet import contact_sheet
from ...patchnet_addon.image.heatmap import magnify, with_legend
from ...patchnet_addon.runtime.quantities import error_text
from ..computing.cycles_pixels import COMPOSITED, FULL, CyclesView
from ..computing.views import ERROR_MAXIMUM
from ..scene_access.images import save_png, show_image

_SHEET_NAME = "cycles_compare.png"
_DIMMED = 0.35  # of the heatmap where Cycles does not render
_NAMES, _COMPARISON_NAMES = ("cycles", "cycles mask"), ("cycles full", "cycles error")


def cycles_file_names(compare: bool) -> list[str]:
    """Names of the files of `save_cycles`, with the full render or without it."""
    names = [_file_name(name) for name in (*_NAMES, *(_COMPARISON_NAMES if compare else ()))]
    return [*names, _SHEET_NAME] if compare else names


def _file_name(picture: str) -> str:
    return f"{picture.replace(' ', '_')}.png"


def cycles_pictures(view: CyclesView) -> dict[str, np.ndarray]:
    """Name -> (h, w, 3) encoded colours; with `compare` also the full render and the errors. Light without a background
    has alpha, (h, w, 4).

    "cycles" and "cycles mask", white where Cycles rendered, have the camera's size.
    """
    pictures = {
        "cycles": _shown(view, view.composited, "composited"),
        "cycles mask": np.repeat(view.mask[..., None].astype(np.float32), 3, axis=-1),
    }
    if view.full is not None:
        pictures |= {"cycles full": _shown(view, view.full, "full"), "cycles error": _errors(view)}
    return pictures


def show_cycles(view: CyclesView) -> tuple[bpy.types.Image, np.ndarray]:
    """Put the pictures into Blender's images, under the camera's name; return the composited one, and its colours."""
    pictures = cycles_pictures(view)
    images = {name: show_image(f"PatchNet {view.camera.name} {name}", item) for name, item in pictures.items()}
    return images["cycles"], pictures["cycles"]


def save_cycles(view: CyclesView, folder: Path, maximum: float) -> None:
    """Write the pictures into the camera's folder; maximum: end of the heatmap in their overview."""
    for name, picture in cycles_pictures(view).items():
        save_png(folder / _file_name(name), picture)
    if view.full is not None:
        save_png(folder / _SHEET_NAME, comparison_sheet(view, maximum))


def comparison_sheet(view: CyclesView, maximum: float) -> np.ndarray:
    """(h, w, 3): preview, heatmap of the chosen pixels, composited and full render, with the figures as titles."""
    assert view.full is not None
    report = view.report
    mse, seconds, unrefined = report["mse"], report["seconds"], report["unrefined"]
    heat = colormap(view.priority / np.float32(maximum))
    chosen = np.where(view.mask[..., None], heat, heat * np.float32(_DIMMED))
    titles = [
        f"{unrefined.capitalize()} error {error_text(mse[unrefined])}",
        f"Chosen {report['pixels_share']:.1%}",
        f"Cycles {seconds['pixels']:.1f} s error {error_text(mse[COMPOSITED])}",
        f"Full {seconds['full']:.1f} s error {error_text(mse[FULL])}",
    ]
    lit = {"preview": view.preview, "composited": view.composited, "full": view.full}
    preview, composited, full = (opaque(_shown(view, light, item)) for item, light in lit.items())
    row = [preview, chosen, composited, full]
    name = f"{view.camera.name}: {report['samples']} samples, error x 10,000 against {report['reference_samples']}"
    return contact_sheet([row], [name], titles)


def _shown(view: CyclesView, light: np.ndarray, name: str) -> np.ndarray:
    """Encoded colours of light (H, W) or (H, W, 3) over the view's background; name: of its alpha."""
    alpha = view.alphas[name]
    return view.ground.picture(light.reshape(alpha.size, *light.shape[2:]), alpha.ravel())


def _errors(view: CyclesView) -> np.ndarray:
    names = view.report["unrefined"], COMPOSITED, FULL
    views = [magnify(colormap(view.errors[name] / np.float32(ERROR_MAXIMUM))) for name in names]
    titles = [f"{name}: error {error_text(view.report['mse'][name])}" for name in names]
    ticks = [f"{ERROR_MAXIMUM * share:.3g}" for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    return with_legend(views, titles, colormap, ticks, "luminance error against Cycles (above: squared x 10,000)")
