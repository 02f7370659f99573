# SPDX-License-Identifier: GPL-3.0-or-later
"""Make fitted.jpg: the courtyard's close view as a camera-fitted octree, beside a uniform one with as many leaves.

    python docs/pictures/make_fitted.py

Pictures are one ray per pixel, 1080 x 1080, cropped; the lower row shows in white which pixels have look-ahead.
Needs the extras `blender` and `bench`.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import bpy  # noqa: TID251
import numpy as np
from PIL import Image

from patchnet.__main__ import leave
from patchnet.operators.demo_scene import save_demo_scene
from patchnet.operators.scene.cameras import choose_cameras
from patchnet.operators.scene.files import open_scene
from patchnet.operators.scene.read import read_scene
from patchnet.patchnet_addon.image.contact_sheet import contact_sheet
from patchnet.patchnet_addon.image.tone import gray, to_bytes
from patchnet.patchnet_addon.lod.depth import coarse_octree, estimate
from patchnet.patchnet_addon.lod.fit import fit_leaf_levels
from patchnet.patchnet_addon.octree.build import build_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.bounds import MAX_DEPTH
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.shading import opacity_shade, two_lights_shade
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.render import first_hits

CAMERA = "Close"
SIDE_PX = 1080
CROP = np.s_[230:750, 300:820]  # rows from below, columns


def views(octree: Octree, camera: Camera) -> list[np.ndarray]:
    """Preview and look-ahead (h, w, 3), cropped, row 0 at the bottom."""
    hits = first_hits(octree, camera)
    ahead = np.where(hits.hit, octree.look_ahead()[hits.node], False)
    print(f"{octree.leaf_count:,} leaves to depth {octree.depth}: look-ahead on {ahead[hits.hit].mean():.1%} of hits")
    pictures = (hits.luminance, ahead.astype(np.float32))
    return [gray(values.reshape(SIDE_PX, SIDE_PX)[CROP]) for values in pictures]


def main() -> None:
    """Write fitted.jpg beside this file."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "courtyard.blend"
        save_demo_scene(scene)
        open_scene(scene)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    source = read_scene(depsgraph)
    (camera,) = choose_cameras(depsgraph, [CAMERA], (SIDE_PX, SIDE_PX), source.bounds_world)
    grid, shade = Grid.around(source.bounds_world, MAX_DEPTH), two_lights_shade(source)
    fitted = drain(fit_leaf_levels(source, grid, [camera], opacity_shade(source)))
    coarse = drain(coarse_octree(source))
    depth = min(range(8, MAX_DEPTH), key=lambda level: abs(np.log(estimate(coarse, level)[0] / fitted.leaves)))
    uniform = drain(build_octree(source, replace(grid, depth=depth), shade))
    fine = drain(build_octree(source, grid, shade, layout=fitted.layout, exposure=uniform.exposure))
    columns = [views(octree, camera) for octree in (uniform, fine)]
    rows = [list(row) for row in zip(*columns, strict=True)]
    sheet = contact_sheet(rows, ["One ray per pixel", "Look-ahead"], [f"Uniform, depth {depth}", "Fitted"])
    Image.fromarray(to_bytes(sheet[::-1])).convert("L").save(Path(__file__).with_name("fitted.jpg"), quality=78)
    leave(0)


if __name__ == "__main__":
    main()
