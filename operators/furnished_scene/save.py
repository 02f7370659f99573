# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of a composed scene: .glb for evaluations and other programs, .blend with light and camera."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import bpy

from ...patchnet_addon.runtime.errors import OutputError
from ...patchnet_addon.runtime.file_kinds import BLEND, GLB
from ...patchnet_addon.runtime.interrupt import interrupts_wait
from ...patchnet_addon.runtime.replace import replaced_path

ENDINGS = {".blend": BLEND, ".glb": GLB}


def save_composed(path: Path) -> None:
    """Write the open scene, with its images, as the ending of `path` says.

    A .glb has no lamps, so that commands light it by their own sun and sky; no format of theirs keeps a sky. Raises
    OutputError if it cannot be written.
    """
    ending = path.suffix.lower()
    with tempfile.TemporaryDirectory(prefix="patchnet-") as folder, replaced_path(path, ENDINGS[ending]) as temporary:
        made = Path(folder) / f"scene{ending}"
        try:
            with interrupts_wait():
                _write(made)
        except RuntimeError as cause:
            raise OutputError(f"{path} cannot be written ({cause}): choose another folder or make room") from cause
        shutil.copyfile(made, temporary)


def _write(path: Path) -> None:
    if path.suffix == ".blend":
        bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, copy=True)
        return
    if not hasattr(bpy.types, "EXPORT_SCENE_OT_gltf"):
        import addon_utils

        addon_utils.enable("io_scene_gltf2", default_set=False)
    bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLB", export_lights=False, export_cameras=False)
