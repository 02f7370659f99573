# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures and report of a light check as files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from ...patchnet_addon.image.comparison import difference_picture, side_by_side
from ...patchnet_addon.image.contact_sheet import contact_sheet
from ...patchnet_addon.image.heatmap import magnify
from ...patchnet_addon.image.tone import gray
from ...patchnet_addon.runtime.file_kinds import PNG, REPORT, FileKind
from ..pipeline.reports import REPORT_NAME, write_report
from ..scene_access.images import save_png
from .check import CameraCheck, LightCheck

_PICTURES = ("cycles.png", "octree.png", "difference.png", "side_by_side.png")
_WHOLE_VOXELS = "whole_voxels.png"


def check_files(folders: Iterable[str], whole_voxels: bool = False) -> dict[str, FileKind]:
    """Kind of each file of a light check by its path in the output folder; `folders` are those of the cameras."""
    names = (*_PICTURES, _WHOLE_VOXELS) if whole_voxels else _PICTURES
    return {REPORT_NAME: REPORT} | {f"{folder}/{name}": PNG for folder in folders for name in names}


def save_check(check: LightCheck, folder: Path, maximum: float, folders: Mapping[str, str]) -> None:
    """Write report.json, and pictures into the folder of each camera; `folders` are those by cameras' names."""
    for item in check.cameras:
        item.report["folder"] = folders[item.camera.name]
        target = folder / folders[item.camera.name]
        target.mkdir()
        _save_camera(item, target, maximum)
    write_report(folder, "light check", check.report)


def _save_camera(item: CameraCheck, folder: Path, maximum: float) -> None:
    ratio = item.report["mean_ratio"]
    figures = f"{item.report['psnr_db']:.1f} dB, mean ratio {'-' if ratio is None else format(ratio, '.3f')}"
    cycles, octree, difference, beside = (folder / name for name in _PICTURES)
    save_png(cycles, magnify(gray(item.cycles)))
    save_png(octree, magnify(gray(item.octree)))
    title, quantity = f"{item.camera.name}: {figures}", "luminance, octree less Cycles"
    save_png(difference, difference_picture(item.octree - item.cycles, maximum, title, quantity))
    titles = "Cycles", "octree", figures
    save_png(beside, side_by_side(item.cycles, item.octree, maximum, titles))
    if item.whole is not None:
        figures = f"{item.report['whole_voxels']['psnr_db']:.1f} dB, {item.report['psnr_db']:.1f} dB"
        row = [gray(picture) for picture in (item.cycles, item.whole, item.octree)]
        name = f"{item.camera.name}: {figures}"
        save_png(folder / _WHOLE_VOXELS, contact_sheet([row], [name], ["Cycles", "whole voxels", "boxes"]))
