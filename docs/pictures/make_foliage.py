# SPDX-License-Identifier: GPL-3.0-or-later
"""Make foliage.jpg: plants of San Miguel as octrees with their alpha cut out, beside the same with alpha ignored.

    PATCHNET_SCENES=FOLDER python docs/pictures/make_foliage.py

FOLDER holds san_miguel.glb (Guillermo M. Leal Llaguno, CC BY 3.0, from Morgan McGuire's Computer Graphics Archive).
Needs about 8 GiB of memory and the extras `blender` and `bench`.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import bpy  # noqa: TID251
import numpy as np
from PIL import Image

from patchnet.__main__ import leave
from patchnet.operators.scene.files import open_scene
from patchnet.operators.scene.read import read_scene
from patchnet.patchnet_addon.image.contact_sheet import contact_sheet
from patchnet.patchnet_addon.image.tone import gray, to_bytes
from patchnet.patchnet_addon.octree.build import build_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, MeshSource, TriangleBatch, TriangleMesh
from patchnet.patchnet_addon.surface.shading import two_lights_shade
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.supersample import supersample

SIDE_PX = 520
SAMPLES = 16
DEPTH = 10


@dataclass(frozen=True)
class View:
    """A camera before the triangles in a box, metres."""

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    position: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float


VIEWS = (
    View("Palm", (8.6, 1.2, 0.2), (11.6, 3.6, 3.2), (9.75, -0.6, 2.1), (9.45, 2.4, 1.5), 30.0),
    View("Judas tree", (5.8, -9.6, 0.3), (8.3, -7.2, 2.8), (9.4, -6.4, 2.4), (7.0, -8.4, 1.6), 32.0),
)


def cropped(source: MeshSource, view: View, materials: tuple[Material, ...]) -> TriangleMesh:
    """Triangles of `source` in the view's box."""
    parts = []
    for batch in source.batches():
        inside = ((batch.corners_world >= view.low) & (batch.corners_world <= view.high)).all(axis=(1, 2))
        if inside.any():
            parts.append(TriangleBatch(batch.corners_world[inside], batch.uvs[inside], batch.materials[inside], 0))
    return TriangleMesh(tuple(parts), materials)


def picture(mesh: TriangleMesh, view: View) -> np.ndarray:
    """(H, W, 3) sRGB of the octree of `mesh` under two opposite lights, row 0 at the bottom."""
    octree = drain(build_octree(mesh, Grid.around(mesh.bounds_world, DEPTH), two_lights_shade(mesh)))
    print(f"{view.name}: {octree.leaf_count:,} voxels of {octree.grid.voxel_size_world * 1000:.1f} mm")
    camera = Camera.look_at(
        np.array(view.position), np.array(view.target), fov=np.radians(view.fov), size_px=(SIDE_PX, SIDE_PX)
    )
    return gray(drain(supersample(octree, camera, SAMPLES)).reshape(SIDE_PX, SIDE_PX))


def main() -> None:
    """Write foliage.jpg beside this file."""
    open_scene(Path(os.environ["PATCHNET_SCENES"]) / "san_miguel.glb")
    source = read_scene(bpy.context.evaluated_depsgraph_get())
    cut = source.materials
    solid = tuple(replace(each, alpha=1.0, alpha_texture=None, alpha_threshold=None) for each in cut)
    rows = [[picture(cropped(source, view, materials), view) for materials in (cut, solid)] for view in VIEWS]
    sheet = contact_sheet(rows, [view.name for view in VIEWS], ["Alpha cut out", "Alpha ignored"])
    Image.fromarray(to_bytes(sheet[::-1])).convert("L").save(Path(__file__).with_name("foliage.jpg"), quality=72)
    leave(0)


if __name__ == "__main__":
    main()
