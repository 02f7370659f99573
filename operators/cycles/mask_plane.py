# SPDX-License-Identifier: GPL-3.0-or-later
"""Plane before a camera that limits a Cycles render to any set of pixels: transparent there, a holdout elsewhere.

A holdout pixel costs one ray. Only camera rays meet the plane, so that it does not change light and shadows; one more
transparent bounce compensates for it. Samples differ from those of a render without it, but have the same mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy
import numpy as np

from ...patchnet_addon.tracing.camera import PERSPECTIVE, Camera
from ..scene_access.temporary import temporary

_ONLY_CAMERA = (
    "visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter", "visible_shadow",
)  # fmt: skip
_BEYOND_CLIP = 1.01  # of the clip start


@contextmanager
def mask_plane(scene: bpy.types.Scene, camera: Camera, mask: np.ndarray, depth_world: float) -> Iterator[None]:
    """Put the plane into a scene copy within the block, before all pixels that are not in `mask`.

    mask: (H, W) bool, row 0 at the bottom. depth_world: of the nearest surface. The plane stands halfway to it: much
    nearer, float32 would not resolve its pixels in a large scene.
    """
    height, width = mask.shape
    with ExitStack() as stack:
        image = stack.enter_context(
            temporary(bpy.data.images.new("PatchNet Mask", width, height, float_buffer=True, is_data=True))
        )
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., :3] = mask[..., None]
        image.pixels.foreach_set(pixels.ravel())
        image.update()
        material = stack.enter_context(temporary(bpy.data.materials.new("PatchNet Mask")))
        _shade(material, image)
        mesh = stack.enter_context(temporary(bpy.data.meshes.new("PatchNet Mask")))
        _fill(mesh, camera, max(camera.clip_start * _BEYOND_CLIP, min(depth_world, camera.clip_end) / 2.0))
        mesh.materials.append(material)
        item = stack.enter_context(temporary(bpy.data.objects.new("PatchNet Mask", mesh)))
        item.location = camera.position_world
        for name in _ONLY_CAMERA:
            setattr(item, name, False)
        scene.collection.objects.link(item)
        scene.cycles.transparent_max_bounces += 1
        yield


def _fill(mesh: bpy.types.Mesh, camera: Camera, depth_world: float) -> None:
    """Fill the mesh with a quad that covers the camera's picture at a depth, with UVs of the picture."""
    spread = depth_world if camera.kind == PERSPECTIVE else 1.0
    across, up = np.asarray(camera.right) * camera.half_x * spread, np.asarray(camera.up) * camera.half_y * spread
    forward = np.asarray(camera.forward) * depth_world
    places = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
    corners = [forward + across * (x + camera.shift_x) + up * (y + camera.shift_y) for x, y in places]
    mesh.from_pydata([corner.tolist() for corner in corners], [], [(0, 1, 2, 3)])
    coordinates = mesh.uv_layers.new(name="Picture").data
    for index, (x, y) in enumerate(places):
        coordinates[index].uv = (x + 1.0) / 2.0, (y + 1.0) / 2.0


def _shade(material: bpy.types.Material, image: bpy.types.Image) -> None:
    """Make a material transparent where the image is 1, a holdout elsewhere."""
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    kinds = ("OutputMaterial", "MixShader", "Holdout", "BsdfTransparent", "TexImage")
    output, mix, holdout, clear, texture = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    texture.image, texture.interpolation, texture.extension = image, "Closest", "EXTEND"
    tree.links.new(texture.outputs["Color"], mix.inputs[0])
    tree.links.new(holdout.outputs[0], mix.inputs[1])
    tree.links.new(clear.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
