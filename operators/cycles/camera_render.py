# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles reference render of the baked light, diffuse light and emission, through a camera of the tracer.

Direct and indirect diffuse light times diffuse colour, plus emission, equals a combined bake of these parts. The passes
are read from a multi-layer EXR, which neither the compositor nor view settings affect.
"""

from __future__ import annotations

import tempfile
from contextlib import nullcontext
from pathlib import Path

import bpy

from ...patchnet_addon.image.cycles_passes import Reference, read_reference
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.tracing.camera import Camera
from .daylight import daylight, has_light
from .scene_copy import prepared, render

_PASSES = (
    "use_pass_combined", "use_pass_z", "use_pass_normal", "use_pass_diffuse_direct", "use_pass_diffuse_indirect",
    "use_pass_diffuse_color", "use_pass_emit",
)  # fmt: skip
# What Fast GI adds is in Combined and in bakes, but in no pass: it is what these passes leave of Combined.
_OTHERS = [f"use_pass_{kind}_{part}" for kind in ("glossy", "transmission", "volume")
           for part in ("direct", "indirect", "color")]  # fmt: skip


def render_halves(context: bpy.types.Context, camera: Camera, samples: int) -> Steps[list[Reference]]:
    """Two renders of half the samples each, in the light of the bake; raises SceneError as `render_reference`."""
    halves: list[Reference] = []
    for seed in (1, 2):
        yield Progress(len(halves), 2, "Cycles")
        lit = has_light(context.evaluated_depsgraph_get())
        with nullcontext() if lit else daylight(context.scene):
            halves.append(render_reference(context, camera, samples // 2, seed))
    return halves


def render_reference(context: bpy.types.Context, camera: Camera, samples: int, seed: int) -> Reference:
    """Render a copy of the scene; raises SceneError if Cycles is missing or fails."""
    with tempfile.TemporaryDirectory(prefix="patchnet-") as folder:
        path = Path(folder) / "reference.exr"
        with prepared(context, camera, samples, seed, path) as (scene, layer):
            add_passes(layer)
            render(scene, path)
        return read_reference(path)


def add_passes(layer: bpy.types.ViewLayer) -> None:
    """Enable the passes that `image/cycles_passes.py` reads in a view layer of a copied scene."""
    cycles = layer.id_data.cycles
    others = _OTHERS if cycles.use_fast_gi and cycles.fast_gi_method == "ADD" else ()
    for name in (*_PASSES, *others):
        for owner in (layer, layer.cycles):
            if hasattr(owner, name):
                setattr(owner, name, True)
