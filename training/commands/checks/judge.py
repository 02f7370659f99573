# SPDX-License-Identifier: GPL-3.0-or-later
"""Judge of the open scene: its light agrees with Cycles, or a note says what does not, or it is wrong."""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ....operators.settings.job_settings import JobSettings
from ....operators.verify_light import CheckSettings, verify_light
from ....patchnet_addon.runtime.errors import PatchNetError
from ....patchnet_addon.runtime.progress import drain
from .materials import make_plain

if TYPE_CHECKING:
    from ....operators.verify_light import CameraCheck, LightCheck

RIGHT, SAID, WRONG = WORDS = ("right", "said", "wrong")
SIZE_PX, BAKED_PATHS, RENDERED_PATHS, _RAYS = 48, 8, 32, 6
LEAST_PSNR_DB, RATIO = 24.0, 0.06  # without noise: edges of voxels, and filtered light
_BLACK = 0.002  # mean luminance that an 8-bit picture rounds to black
_SIGMAS = 3.0
_NAMED = re.compile(r"'([^']+)'")


@dataclass(frozen=True, eq=False)
class Verdict:
    """Verdict on a scene.

    word: one of WORDS. why: figures, note or error, in a line. check: figures and pictures, None after an error.
    """

    word: str
    why: str
    check: LightCheck | None = None


def judge(make: Callable[[], None] | None = None, *, explained: bool = True) -> Verdict:
    """Judge the open scene, which that may change. make: makes it first. explained: whether notes are considered."""
    check: LightCheck
    try:
        if make is not None:
            make()
        check = drain(verify_light(bpy.context, _settings()))
    except PatchNetError as error:
        return Verdict(SAID, str(error))
    except Exception as error:  # noqa: BLE001  the next seed is judged all the same
        where = traceback.extract_tb(error.__traceback__)[-1]
        return Verdict(WRONG, f"{error!r} in {Path(where.filename).name}:{where.lineno}")
    short_db, dark_or_bright = shortfall(check.cameras[0])
    figures = check.report["cameras"][0]
    ratio = figures["mean_ratio_where_both_hit"]
    mean = "-" if ratio is None else f"{ratio:.3f}"
    why = f"{figures['psnr_db']:.1f} dB, ratio {mean}, noise {figures['reference_noise_db']:.1f} dB"
    if short_db <= 0.0 and not dark_or_bright:
        return Verdict(RIGHT, why, check)
    notes = check.report["warnings"]
    if explained and notes and _explains(notes):
        return Verdict(SAID, f"{why}; {' '.join(notes)}", check)
    return Verdict(WRONG, why, check)


def _settings() -> CheckSettings:
    light = {"max_samples": BAKED_PATHS, "noise_threshold": 1e-4, "gloss": "off", "color": False}
    job = JobSettings.of(size=(SIZE_PX, SIZE_PX), cameras=(), **light)
    return CheckSettings(job, render_samples=RENDERED_PATHS, rays=_RAYS)


def shortfall(seen: CameraCheck) -> tuple[float, bool]:
    """Return by how many dB a picture falls short of a right one, and whether the mean where both hit is wrong.

    The variance of Cycles' picture, and of light of fewer paths in proportion, is allowed on top of LEAST_PSNR_DB.
    Silhouettes count in dB only: small objects look wider in voxels of two pixels.
    """
    variance = 10.0 ** (-seen.report["reference_noise_db"] / 10.0) * (1.0 + RENDERED_PATHS / BAKED_PATHS)
    least_db = -10.0 * float(np.log10(10.0 ** (-LEAST_PSNR_DB / 10.0) + variance))
    ratio, mean = seen.report["mean_ratio_where_both_hit"], float(seen.cycles.mean())
    black = _BLACK * seen.report["both_hit_share"]
    allowed = RATIO * mean + black + _SIGMAS * float(np.sqrt(variance / seen.cycles.size))
    return least_db - seen.report["psnr_db"], ratio is not None and abs(ratio - 1.0) * mean > allowed


def _explains(notes: list[str]) -> bool:
    """Return whether the light is right once the objects that notes name are left out, and the materials are plain."""
    names = {name for note in notes for name in _NAMED.findall(note)}
    camera = bpy.context.scene.camera
    if camera is not None and camera.name in names:
        return True
    items = [item for item in bpy.data.objects if item.name in names]
    materials = [material for material in bpy.data.materials if material.name in names]
    for item in items:
        bpy.data.objects.remove(item)
    for material in materials:
        make_plain(material)
    return bool(items or materials) and judge(explained=False).word != WRONG
