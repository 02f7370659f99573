# SPDX-License-Identifier: GPL-3.0-or-later
"""Share of the pixels of the demo's fences that are refined in its far view, by strategy.

    python docs/pictures/make_fence.py out/demo

reads courtyard.blend and codes.safetensors of a demo. A pixel is the fence's if 4 x 4 rays of Blender through it meet
the fence (its bars, or the wire of the chain-link) and something else.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy  # noqa: TID251
import numpy as np
from mathutils import Vector  # noqa: TID251

from patchnet.operators.scene.cameras import tracing_camera
from patchnet.patchnet_addon.codes.file import load_codes
from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.training.strategies.registry import EVALUATED

STRATEGIES = ("optimal", "patchnet-plus", "patchnet-plus-1", "patchnet-plus-0", "patchnet", "ss-variance", "random")
_BUDGET, _SIDE, _SIZE = 0.3, 4, 192
_FENCES = ("Fence ", "Chain-link ")


def main(folder: Path) -> None:
    """Print the share of fence pixels that each strategy refines, and of their squared error."""
    bpy.ops.wm.open_mainfile(filepath=str(folder / "courtyard.blend"))
    scene = bpy.context.scene
    camera = tracing_camera(bpy.data.objects["Far"], scene, (_SIZE, _SIZE))
    coded = load_codes(folder / "codes.safetensors", load_octree(folder / "octree.safetensors"), load_weights())
    chosen = [EVALUATED[name] for name in STRATEGIES]
    buffers = drain(trace_view(coded.octree, camera, chosen, coded=coded))
    assert buffers.reference is not None
    share = fence_share(scene, camera).ravel()
    fence = (share > 0) & (share < 1) & buffers.active
    error = (buffers.preview.astype(np.float64) - buffers.reference) ** 2
    wrong = fence & (error > 0.01)  # by a tenth of white
    print(f"{fence.sum()} pixels of the fence, {wrong.sum()} of them wrong by more than 0.1")
    print("| strategy | fence | wrong pixels of it | their squared error |\n|---|---|---|---|")
    for strategy in chosen:
        refined = rank(strategy, buffers, _BUDGET).mask
        shares = refined[fence].mean(), refined[wrong].mean(), error[wrong & refined].sum() / error[wrong].sum()
        print(f"| `{strategy.name}` | " + " | ".join(f"{each:.0%}" for each in shares) + " |")


def fence_share(scene: bpy.types.Scene, camera: Camera) -> np.ndarray:
    """Share (H, W) of the rays through each pixel that meet a fence first; row 0 is the lowest."""
    graph, start = bpy.context.evaluated_depsgraph_get(), Vector(camera.position_world)
    found = np.zeros((camera.height_px, camera.width_px))
    steps = (np.arange(_SIDE) + 0.5) / _SIDE
    for row, column in np.ndindex(found.shape):
        for v in (row + steps) / camera.height_px * 2 - 1:
            for u in (column + steps) / camera.width_px * 2 - 1:
                ray = camera.forward + u * camera.half_x * camera.right + v * camera.half_y * camera.up
                item = scene.ray_cast(graph, start, Vector(ray).normalized())[4]
                found[row, column] += item is not None and item.name.startswith(_FENCES)
    return found / _SIDE**2


if __name__ == "__main__":
    main(Path(sys.argv[1]))
