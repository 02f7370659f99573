# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures and report of a comparison as files."""

from __future__ import annotations

import json
from pathlib import Path

import bpy

from ...patchnet_addon.image.difference import difference_picture, side_by_side
from ...patchnet_addon.image.heatmap import magnify
from ...patchnet_addon.image.tone import gray
from ..images import save_png
from .check import CameraCheck, LightCheck

REPORT_NAME = "report.json"


def save_check(check: LightCheck, folder: Path, maximum: float) -> None:
    """Write report.json, and cycles, octree, difference and side_by_side.png into a folder named after each camera."""
    for item in check.cameras:
        target = folder / (bpy.path.clean_name(item.camera.name) or "camera")
        target.mkdir()
        _save_camera(item, target, maximum)
    text = json.dumps(check.report, indent=2, allow_nan=False)
    (folder / REPORT_NAME).write_text(text + "\n", encoding="utf-8")


def _save_camera(item: CameraCheck, folder: Path, maximum: float) -> None:
    ratio = item.report["mean_ratio"]
    figures = f"{item.report['psnr_db']:.1f} dB, mean ratio {'-' if ratio is None else format(ratio, '.3f')}"
    save_png(folder / "cycles.png", magnify(gray(item.cycles)))
    save_png(folder / "octree.png", magnify(gray(item.octree)))
    title, quantity = f"{item.camera.name}: {figures}", "luminance, octree less Cycles"
    save_png(folder / "difference.png", difference_picture(item.octree - item.cycles, maximum, title, quantity))
    titles = "Cycles", "octree", figures
    save_png(folder / "side_by_side.png", side_by_side(item.cycles, item.octree, maximum, titles))
